"""The mapper's sweep on an NVIDIA GPU; imported only where `device` asks for it."""
