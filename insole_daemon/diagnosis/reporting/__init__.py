"""report.html: a first page for gait scientists, then all figures for a reviewer."""
