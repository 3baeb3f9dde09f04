"""From a recording to curves: steps that can be switched off and are recorded, in the order of ``chain``.

What a step cannot make curves of it refuses by a CurveError that names the file, the row and its time stamp
where there is one, and what to do.
"""
