"""Material cards: a fitted material in the convention of another program, with its formula and range."""
