"""The examples in docstrings print what they say."""

import doctest
import importlib
import inspect

from tests.test_docs import FACES

#: Names that have one.
LEAST = 19


def test_examples_in_docstrings_run():
    finder, runner = (
        doctest.DocTestFinder(recurse=True),
        doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE),
    )
    names = set()
    for face in FACES:
        module = importlib.import_module(face)
        for name in getattr(module, "__all__", ()):
            value = getattr(module, name)
            if inspect.isclass(value) or inspect.isfunction(value):
                for test in finder.find(value, f"{face}.{name}", module=False):
                    if test.examples:
                        names.add(test.name)
                        runner.run(test)
    assert runner.summarize(verbose=False).failed == 0
    assert len(names) >= LEAST
