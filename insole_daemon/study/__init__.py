"""A study: many recordings of many people, analysed by workers and collected into one table and one page."""
