"""What a pixel sees between two frames: the light of both, carried along the image motion."""
