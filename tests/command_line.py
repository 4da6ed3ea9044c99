"""The command line called in this process, for its tests."""

from bsface import __main__, reconstruct

QUICK = [
    "--set=method=motion",
    "--set=control_points=10,11",
    "--set=detector=false",
    "--set=landmarks=68",
]


def run(capsys, *words, job=reconstruct) -> tuple[int, str, str]:
    """Exit code, what was printed, what was said on stderr."""
    try:
        code = __main__.main([str(w) for w in words], job)
    except SystemExit as end:  # argparse
        code = end.code
    said = capsys.readouterr()
    assert "Traceback" not in said.err
    return code, said.out, said.err
