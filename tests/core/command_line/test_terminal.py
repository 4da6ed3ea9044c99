"""Terminals that take nothing, or not everything."""

import os
import shlex
import subprocess
import sys

import pytest
from command_line import QUICK
from needs import needs_full_device

SAYS = "from bsface.cli import terminal; import sys\n"


@needs_full_device
def test_output_that_cannot_be_printed(photos, tmp_path):
    """`--json > /dev/full`: a sentence, and no second complaint when Python ends."""
    out = str(tmp_path / "a.npz")
    words = [sys.executable, "-m", "bsface", str(photos), "-o", out, "--json", "-q"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*words, *QUICK], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert done.returncode == 1
    assert done.stderr == (
        "bsface: the standard output cannot be written (No space left on device).\n"
    )


@needs_full_device
@pytest.mark.parametrize("command", [[], ["batch"], ["export"], ["info"], ["models"]])
def test_help_that_cannot_be_printed(capfd, command):
    with open("/dev/full", "w") as full:
        words = [sys.executable, "-m", "bsface", *command, "--help"]
        assert subprocess.run(words, stdout=full).returncode == 1
    assert "cannot be written" in capfd.readouterr().err


@needs_full_device
@pytest.mark.parametrize("ending", ["2>/dev/full", "2>&-", "2>&1 | true"])
def test_sentences_that_nobody_reads_do_no_harm(ending):
    """Also not at the end, when Python flushes what it could not write."""
    program = f"{SAYS}terminal.say('hello.'); terminal.tell('bye')"
    words = f"{shlex.quote(sys.executable)} -c {shlex.quote(program)} {ending}"
    found = subprocess.run(["sh", "-c", words], capture_output=True, text=True)
    assert (found.returncode, found.stdout, found.stderr) == (0, "", "")


@pytest.mark.parametrize(
    "ending, code, said",
    [
        (">&-", 1, "bsface: the standard output is closed.\n"),
        ("| head -c 1 > /dev/null", 0, ""),
    ],
)
def test_results_that_cannot_be_written(ending, code, said):
    program = f"{SAYS}sys.exit(terminal.write_out('{{}}'))"
    words = f"{shlex.quote(sys.executable)} -c {shlex.quote(program)} {ending}"
    found = subprocess.run(["sh", "-c", words], capture_output=True, text=True)
    assert (found.returncode, found.stderr) == (code, said)


def test_a_terminal_without_the_letters_of_a_name():
    program = f"{SAYS}sys.exit(terminal.write_out('gr\\u00f6\\u00dfe \\udcff'))"
    found = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
        capture_output=True,
        text=True,
    )
    assert (found.returncode, found.stdout) == (0, "gr\\xf6\\xdfe \\udcff")
