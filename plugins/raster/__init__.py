"""A renderer of compiled loops in MuJoCo's place: no graphics library draws."""
