import sys

import pytest

from twincell.cli import main
from twincell.compiling import COMPILING


@pytest.fixture
def twincell(monkeypatch, capsys):
    """Run a command line: exit code, stdout, stderr."""

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["twincell", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        err = err.replace(f"{COMPILING}\n", "")  # by whoever needs a kernel first
        code = ended.value.code
        return (0 if code is None else code), out, err

    return run


@pytest.fixture
def one_sentence():
    """What every refusal must be: exit 1, one line on stderr, no traceback."""

    def check(result, *says):
        code, _, err = result
        assert code == 1, result
        assert "Traceback" not in err
        assert len(err.strip().splitlines()) == 1, err
        for text in says:
            assert text in err, err

    return check
