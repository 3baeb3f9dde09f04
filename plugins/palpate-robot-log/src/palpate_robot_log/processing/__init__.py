"""From a recording to curves: one step a module, each switchable, each recorded.

:func:`palpate_robot_log.processing.chain.process` does all of them in order; every step is a
function of its own.
"""
