"""The commands of the checkweigher, one module each: `add_arguments(parser)` and `run(arguments)`.

The modules import what is heavy in `run` alone, so that ``--help`` is there at once.
"""
