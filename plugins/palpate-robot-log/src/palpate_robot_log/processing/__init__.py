"""From a recording to curves: steps that can be switched off and are recorded, in the order of ``chain``."""
