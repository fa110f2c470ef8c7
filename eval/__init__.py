"""The benchmark: metrics, cases, runner, results, report and the command line."""
