"""The methods that ray density fusion is compared with, on the same input and in the same scores.

Each is a `DepthEstimator`: recording, window and reference view in, one depth map out. All of them
match two cameras, so `rectify` brings a stereo pair to common rows; most of them look at
`time_surface` images. `catalogue` names them.
"""
