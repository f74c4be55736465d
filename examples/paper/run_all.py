"""All of the paper's experiments, in an order that soon gives something to look at.

Each step uses what earlier ones have measured, and then makes the page again. Stop at
any time: the next run continues where this one stopped.
"""

import sys

import figure4
import learning
import novel_task
import page
import table2
from measuring import runner

COMMAND = "python examples/paper/run_all.py"
STEPS = (
    (table2, ["--sizes", "20", "170"]),
    (figure4, ["--sizes", "280"]),
    (novel_task, ["--draws", "0"]),
    (learning, []),
    (figure4, ["--sizes", "280", "476", "532", "896"]),
    (novel_task, []),
    (table2, ["--sizes", "20", "170", "1004"]),
    (figure4, []),
    (table2, []),
)
SHORT_STEPS = tuple((module, []) for module in (table2, figure4, learning, novel_task))


def main():
    """Measure everything."""
    argv = sys.argv[1:]
    arguments = runner.parse_common(__doc__.splitlines()[0], argv)
    command = runner.public(COMMAND, argv)
    for module, options in SHORT_STEPS if arguments.short else STEPS:
        runner.main(module.EXPERIMENT, [*options, *argv], command)
        page.make(arguments.results)


if __name__ == "__main__":
    main()
