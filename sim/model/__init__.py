"""Models of the user: files in MJCF or URDF, where a rig sits on them, and what moves them."""
