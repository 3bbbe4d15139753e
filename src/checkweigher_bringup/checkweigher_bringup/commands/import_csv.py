"""Turn a CSV log of a scale into a bag."""

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `import`."""


def run(arguments: argparse.Namespace) -> int:
    """Import."""
    return 0
