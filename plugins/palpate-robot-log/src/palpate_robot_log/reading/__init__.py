"""Reading a robot's log: one reader per format, a channel map, and the checks that need no physics."""
