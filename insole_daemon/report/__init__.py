"""Figures and HTML reports: plots and insole maps as SVG in self-contained pages, for light and dark mode."""
