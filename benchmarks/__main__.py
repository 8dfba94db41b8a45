"""Run every benchmark, one after the other: `python -m benchmarks`."""

import sys

from . import flow, identification, plant, transport


def main() -> int:
    """Print every figure; 1 where one lies outside what it is held to."""
    print("# Identification at the limit\n")
    status = identification.main([])
    print("\n# Models with effects\n")
    status = plant.main() or status
    print("\n# Transport and recordings\n")
    transport.main()
    print("\n# The whole flow\n")
    flow.main()
    return status


if __name__ == "__main__":
    sys.exit(main())
