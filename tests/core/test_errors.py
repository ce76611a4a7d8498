import pickle
import re
from pathlib import Path

from duobench.core.errors import LONGEST_TEXT, UnknownNameError, escaped, traceback_text
from tests.evaluation import toy_tasks


def test_traceback_names_no_folder_of_the_machine() -> None:
    try:
        toy_tasks.cannot_be_made()
    except ZeroDivisionError as error:
        text = traceback_text(error)
    assert text.endswith("ZeroDivisionError: no weights\n")
    assert 'evaluation/toy_tasks.py", line ' in text
    assert str(Path(__file__).parents[2]) not in text
    assert not re.search(r'File "/', text)


def test_endless_line_or_traceback_is_cut() -> None:
    line = traceback_text(ValueError("x" * 100_000))
    assert len(line) < 1000
    assert line.endswith("x …\n")
    text = traceback_text(ValueError("begins\n" + "line\n" * 100_000 + "ends"))
    assert len(text) < LONGEST_TEXT + 10
    assert text.startswith("ValueError: begins\n")
    assert text.endswith("\nends\n")


def test_text_of_an_error_can_be_written_and_printed() -> None:
    assert escaped("wörld\n\tok") == "wörld\n\tok"
    assert escaped("a\u202egpj.exe") == "a\\u202egpj.exe"
    text = traceback_text(FileNotFoundError("w-\udcff.bin\x1b[31m\r\x9b"))
    assert text == "FileNotFoundError: w-\\udcff.bin\\x1b[31m\\x0d\\x9b\n"
    text.encode()


def test_error_with_a_composed_message_can_be_pickled() -> None:
    error = UnknownNameError("task", "bin_srot", ["bin_sort"])
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is UnknownNameError
    assert str(UnknownNameError(str(error))) == str(error)  # as Gymnasium's processes make it again
    assert str(again) == str(error)
