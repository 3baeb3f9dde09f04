"""What to measure next: how much a further press would narrow the intervals of a fit."""
