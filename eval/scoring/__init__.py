"""From depth maps and ground truth to numbers, with regions, causes and intervals."""
