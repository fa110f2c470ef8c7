"""From maxima over planes to depth maps, point clouds and meshes."""
