"""The template of job.toml: what its comments say is so."""

import re
import tomllib

import pytest
import trimesh

from analysis.settings import FeaSettings
from planning import PrintSettings
from twincell.job import JobSettings, SlicingSettings, load_job

TABLES = {"slicing": SlicingSettings, "print": PrintSettings, "fea": FeaSettings}


@pytest.fixture
def written(tmp_path, twincell):
    trimesh.creation.box((300.0, 200.0, 50.0)).export(tmp_path / "block.stl")
    assert twincell("new", tmp_path / "block.stl", "-o", tmp_path / "job", "--thickness", "8")[0] == 0
    return tmp_path / "job"


def commented(text):
    """(table, key, value, remark) of every key that is commented out."""
    table, found = None, []
    for line in text.splitlines():
        if heading := re.match(r"\[(\w+)\]", line):
            table = heading[1]
        elif key := re.match(r"# (\w+ = [^#]+?) *(?:# *(.*))?$", line):
            ((name, value),) = tomllib.loads(key[1]).items()
            found.append((table, name, value, key[2] or ""))
    return found


def test_what_is_commented_out_is_the_default_or_an_example(written):
    found = commented((written / "job.toml").read_text())
    assert {name for _, name, *_ in found} >= {"cusp", "height", "top", "clearance", "edge", "time_limit_s"}
    settings = load_job(written).settings
    # Defaults that follow from the thickness, as the settings' docstring has them.
    following = {"resolution": 8.0, "thinnest": 4.0, "thickest": 12.0}
    for table, name, value, remark in found:
        default = getattr(getattr(settings, table), name)
        assert name in TABLES[table].model_fields
        if remark.startswith("example"):
            assert default is None, name
        else:
            assert value == (following[name] if default is None else default), name


def test_what_is_commented_out_can_be_used(written):
    path = written / "job.toml"
    text = path.read_text()
    # A height and a top plane exclude one another.
    lines = [line for line in text.splitlines() if not line.startswith("# height")]
    open_text = "\n".join(re.sub(r"^# (\w+ = )", r"\1", line) for line in lines)
    path.write_text(open_text)
    assert isinstance(load_job(written).settings, JobSettings)
    assert load_job(written).settings.slicing.cusp == 2.0
