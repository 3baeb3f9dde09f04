"""From a recording to curves: one step a module, each switchable, each recorded."""
