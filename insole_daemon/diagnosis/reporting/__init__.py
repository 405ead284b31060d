"""report.html: page one for whoever knows gait, then every number for a reviewer."""
