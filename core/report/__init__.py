"""The report: a page, its facts and a summary picture."""
