"""One run of train.py and what it leaves behind: stages, results, figures, and the table over a sweep."""
