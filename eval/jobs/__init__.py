"""Jobs with inputs and outputs: cached by content, done here or on a cluster."""
