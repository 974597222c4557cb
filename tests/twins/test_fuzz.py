"""Broken files: whatever the bytes are, a part is read and repaired, or the package's own error says why not."""

import logging
import re
import resource
import struct
import subprocess
import sys
import time
import tracemalloc
import warnings

import numpy as np
import pytest
import trimesh
from shapes import box, nested_cavity, torus

from twins import FormatError, TwinsError, check_surface, read_surface, repair_surface

NUMBERS = [
    b"nan",
    b"inf",
    b"-inf",
    b"1e308",
    b"-1e308",
    b"1e-308",
    b"0",
    b"-1",
    b"4294967295",
    b"99999999999999999999",
]
NUMBERS += [b"", b"abc", b"2147483648", b"1000000", b"3.5", b"1/2/3", b"0x10", b"\xff\xfe"]
WORDS = [struct.pack("<f", np.float32(value)) for value in (np.nan, np.inf, -np.inf, 3e38, 1e-40, -0.0)]
WORDS += [struct.pack("<I", value) for value in (0, 1, 2**31, 2**32 - 1, 10**6)]


@pytest.fixture(scope="module")
def seeds():
    files = []
    for mesh in (box(), torus(around=8, across=6), nested_cavity()):
        part = trimesh.Trimesh(np.asarray(mesh.vertices), np.asarray(mesh.faces), process=False)
        if len(part.faces) < 200:
            files += [
                ("stl", part.export(file_type="stl")),
                ("stl", part.export(file_type="stl_ascii").encode()),
                ("obj", part.export(file_type="obj").encode()),
                ("ply", part.export(file_type="ply")),
            ]
        files.append(("ply", part.export(file_type="ply", encoding="ascii")))
    return files


def mutated(rng, content, other):
    """The content with one to four changes of the kinds that broken disks, transfers and programs make."""
    for _ in range((1, 1, 1, 2, 4)[rng.integers(5)]):
        at, upto = sorted(rng.integers(0, len(content) + 1, 2).tolist())
        kind = rng.integers(8)
        if kind == 0:
            spoiled = bytearray(content)
            for place in rng.integers(0, max(len(content), 1), rng.integers(1, 4)):
                if place < len(spoiled):
                    spoiled[place] ^= 1 << int(rng.integers(8))
            content = bytes(spoiled)
        elif kind == 1:
            content = content[:at]
        elif kind == 2:
            content = content[:at] + rng.bytes(int(rng.integers(1, 60))) + content[at:]
        elif kind == 3:
            content = content[:at] + content[min(upto, at + int(rng.integers(1, 200))) :]
        elif kind == 4:
            numbers = list(re.finditer(rb"-?\d+\.?\d*(?:e-?\d+)?", content))
            for match in (
                [numbers[k] for k in sorted(rng.integers(0, len(numbers), 2))][::-1] if numbers else []
            ):
                new = NUMBERS[rng.integers(len(NUMBERS))]
                content = content[: match.start()] + new + content[match.end() :]
        elif kind == 5:
            content = content[:at] + WORDS[rng.integers(len(WORDS))] + content[at + 4 :]
        elif kind == 6:
            content = content[:at] + content[at:upto] * 2 + content[upto:]
        else:
            content = content[:at] + other[at:]
    return content


def survive(seeds, tmp_path, count, seed):
    """Counts what was read and what was refused; anything else fails here."""
    rng = np.random.default_rng(seed)
    outcome = {"repaired": 0, "refused": 0, "slowest": 0.0}
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    longest = 0
    for n in range(count):
        suffix, content = seeds[rng.integers(len(seeds))]
        other = seeds[rng.integers(len(seeds))][1]
        content = rng.bytes(int(rng.integers(0, 2000))) if n % 10 == 9 else mutated(rng, content, other)
        if rng.integers(20) == 0:
            suffix = ("stl", "obj", "ply")[rng.integers(3)]
        path = tmp_path / f"part.{suffix}"
        path.write_bytes(content)
        start = time.perf_counter()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                surface, _ = repair_surface(read_surface(path))
            check_surface(surface)
            outcome["repaired"] += 1
        except TwinsError as error:
            longest = max(longest, len(str(error)))
            outcome["refused"] += 1
        except BaseException:
            (tmp_path.parent / f"found.{suffix}").write_bytes(content)
            raise
        outcome["slowest"] = max(outcome["slowest"], time.perf_counter() - start)
    assert longest < 2000
    assert outcome["slowest"] < 20.0  # the first one compiles
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory < 400_000  # kB
    return outcome


def test_broken_files_are_read_or_refused(seeds, tmp_path, capfd):
    outcome = survive(seeds, tmp_path, 300, 1)
    assert min(outcome["repaired"], outcome["refused"]) > 10
    assert capfd.readouterr() == ("", "")


@pytest.mark.soak
def test_ten_thousand_broken_files_are_read_or_refused(seeds, tmp_path, capfd):
    outcome = survive(seeds, tmp_path, 10_000, 2)
    assert capfd.readouterr() == ("", "")
    logging.getLogger(__name__).info("%s", outcome)
    assert outcome["repaired"] + outcome["refused"] == 10_000


PLY = (
    "ply\nformat {}\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
    "element face {}\n{}\nend_header\n"
)
LIST = "property list uchar int vertex_indices"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("huge.stl", b"\0" * 80 + struct.pack("<I", 4_000_000_000) + b"\0" * 500),
        ("ascii.ply", PLY.format("ascii 1.0", 4_000_000_000, 12, LIST).encode() + b"0 0 0\n" * 20),
        (
            "binary.ply",
            PLY.format("binary_little_endian 1.0", 4_000_000_000, 12, LIST).encode() + b"\0" * 500,
        ),
        ("faces.ply", PLY.format("binary_little_endian 1.0", 4, 4_000_000_000, LIST).encode() + b"\0" * 500),
        ("plain.ply", PLY.format("ascii 1.0", 4, 4_000_000_000, LIST).encode() + b"0 0 0\n" * 20),
        ("long.ply", PLY.format("ascii 1.0", 1, 1, LIST).encode() + b"0 0 0\n4000000000 0 0 0\n"),
        ("index.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4000000000\n"),
    ],
)
def test_counts_that_a_file_cannot_hold_allocate_nothing(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    tracemalloc.start()
    try:
        with pytest.raises(FormatError, match=name):
            read_surface(path)
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()


SPOILT_OBJ = "mtllib none.mtl\nusemtl x\nv 0 0 nan\nv 1 0 1e308\nv 0 1 0\nf 1 2 3\nf 7 8 9\n"
SPOILT_STL = "solid x\n" + 2 * (
    "facet normal 0 x 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
)


@pytest.mark.parametrize(("suffix", "content"), [("obj", SPOILT_OBJ), ("stl", SPOILT_STL)])
def test_a_broken_file_prints_nothing(tmp_path, suffix, content):
    """In a process of its own, where no handler of pytest takes what libraries log."""
    path = tmp_path / f"part.{suffix}"
    path.write_text(content)
    script = (
        "import sys, pathlib, twins\n"
        "try: twins.repair_surface(twins.read_surface(pathlib.Path(sys.argv[1])))\n"
        "except twins.TwinsError: sys.exit(3)"
    )
    done = subprocess.run([sys.executable, "-c", script, str(path)], capture_output=True, timeout=120)
    assert (done.returncode, done.stdout, done.stderr) == (3, b"", b"")
