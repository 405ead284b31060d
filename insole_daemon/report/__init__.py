"""Drawing: curves, maps and self-contained pages, in SVG that follows the light or dark of whoever looks."""
