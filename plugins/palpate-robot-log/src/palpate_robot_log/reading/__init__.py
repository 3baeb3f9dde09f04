"""Reading a robot's log: one reader per format, a channel map, and the checks that need no physics.

A file that is damaged, or has not what the map names, is refused by a CurveError that names the file, row,
time stamp and column as far as they are known, and what to do.
"""
