"""The disparity space image: back-projection, voting, fusion, maxima; swept plane by plane."""
