"""The study of the paper on the phantom: its printed tables, its runs, and the comparison of both."""
