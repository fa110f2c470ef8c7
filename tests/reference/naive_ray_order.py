"""Slow twin of the grouping of rays."""


def order_by_rows(rows, bands, band_rows):
    """Positions of image rows, stably by band; what lies outside, or nowhere, goes to the ends."""

    def band(row):
        if not row > 0:
            return 0
        return min(int(min(row, 1e9)) // band_rows, bands - 1)

    return sorted(range(len(rows)), key=lambda k: band(rows[k]))
