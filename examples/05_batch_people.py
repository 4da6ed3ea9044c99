#!/usr/bin/env python3
"""Many people: one folder of photos each, several processes, restartable.

The photos of the example are of one person; two halves of them stand in for two
people.

    python examples/05_batch_people.py [PHOTOS [OUT]]
"""

import shutil

import bsface
from _arguments import start
from bsface.batch.run import run_batch


def main(photos, out, settings=None):
    """Run the same batch twice; the second finds everything done."""
    people = out / "people"
    for k, name in enumerate(("first", "second")):
        (people / name).mkdir(parents=True, exist_ok=True)
        for path in bsface.list_photos(photos)[k::2]:
            shutil.copy(path, people / name)

    def told(outcome, finished, total):
        print(f"[{finished}/{total}] {outcome.person}: {outcome.status}")

    faces = out / "faces"
    wanted = ("face.npz", "face.step")
    outcomes = run_batch(people, faces, settings, wanted=wanted, workers=2, told=told)
    for outcome in outcomes:
        line = outcome.reason or f"{outcome.used} of {outcome.photos} photos used"
        print(f"{outcome.person}: {line}")

    # Killed half-way it would go on from there; finished people are skipped.
    again = run_batch(people, faces, settings, wanted=wanted, workers=2, told=told)
    print("table of all people:", faces / "summary.csv")
    # Any concurrent.futures executor may do the work instead, such as that of a Dask
    # client: run_batch(..., executor=Client("tcp://host:8786").get_executor())
    return outcomes, again


# Needed here: worker processes import this file.
if __name__ == "__main__":
    start(main, __doc__)
