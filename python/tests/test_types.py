"""The stubs: complete, equal to what is compiled, and enough for a strictly typed program."""

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mypy", reason="the package mypy is not installed")


def run(folder, *arguments):
    # Elsewhere, so that mypy sees the installed package and not the sources beside this folder.
    done = subprocess.run([sys.executable, "-m", *map(str, arguments)], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_typed_program_passes(tmp_path):
    run(tmp_path, "mypy", "--strict", Path(__file__).with_name("typing_example.py"))


def test_the_package_itself_passes(tmp_path):
    run(tmp_path, "mypy", "--strict", "-p", "pkm")


def test_stubs_are_what_is_compiled(tmp_path):
    run(tmp_path, "mypy.stubtest", "pkm._pkm")
