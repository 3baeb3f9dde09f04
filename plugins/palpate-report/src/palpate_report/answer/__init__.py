"""Answer of a run: values, warnings, methods and the next step."""
