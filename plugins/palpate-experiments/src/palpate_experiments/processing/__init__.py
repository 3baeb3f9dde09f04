"""From a recording to curves: one step a module, each switchable, each recorded.

:func:`process` does all of them in order; every step is a function of its own.
"""

from palpate_experiments.processing.chain import process
from palpate_experiments.processing.processed import Processed
from palpate_experiments.processing.settings import ProcessingSettings

__all__ = ["Processed", "ProcessingSettings", "process"]
