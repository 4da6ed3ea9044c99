"""Every sentence the add-on says to the user, with what to do about it.

A core error is a sentence with its remedy already; it is passed on as it is.
"""

from __future__ import annotations

import platform
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING

from ..core.errors import FailureCode

if TYPE_CHECKING:
    from .job import Job

# Statuses of a photo with which nothing is wrong: the icon of their row.
FINE = {"waiting": "BLANK1", "found": "CHECKMARK", "used": "CHECKMARK"}
ICONS = {FailureCode.IGNORED: "HIDE_ON", FailureCode.DUPLICATE: "DUPLICATE"}
# What to do about a photo that is not used.
ADVICE = {
    FailureCode.UNREADABLE: (
        "Open the photo in another program and save it as JPEG or PNG."
    ),
    FailureCode.TOO_LARGE: "Save the photo with fewer pixels; 2000 across is plenty.",
    FailureCode.NO_FACE: "Turn the photo upright, or load landmarks from a .pts file.",
    FailureCode.SMALL_FACE: (
        "Use a closer photo: the face should be at least 60 pixels wide."
    ),
    FailureCode.BLURRED: "Use a sharp photo.",
    FailureCode.DARK: "Use a brighter photo.",
    FailureCode.BRIGHT: "Use a photo that is not overexposed.",
    FailureCode.IMPLAUSIBLE: (
        "Drag the landmarks to their places, or choose another face."
    ),
    FailureCode.OTHER_PERSON: (
        "Choose the right face of this photo, or ignore the photo; if it is the "
        "person, switch One Person off."
    ),
    FailureCode.IGNORED: "You left this photo out; click its box to use it again.",
    FailureCode.DUPLICATE: "The same photo is in the list twice.",
}

NO_PHOTOS = "Add photos of one person first"
NO_FOLDER = "Choose a folder with photos of one person"
RUNNING = "Wait for the running job, or press Cancel"
NOTHING_RUNS = "No job runs"
NO_FACE_OBJECT = "Select a face that BSface made, or press Reconstruct first"
FACE_GONE = "The face was deleted or is in another scene; undo, or run it again"
SCENE_GONE = "The scene of the job was deleted; undo, or run it again"
OTHER_SCENE = "The photo was to be edited in the scene {name}; go back and press again"
SURROUNDED = "{name} surrounds the face and hides the photos behind it"
HIDE = "Hide {name}"
NO_CAMERAS = "This face has no cameras; reconstruct it again"
CANCELLED = "Stopped; the scene is as it was"
NO_SUCH_PHOTO = "There is no photo {name!r} in the list"
NO_ROW = "No photo is chosen; click one in the list"
NOTHING_SELECTED = (
    "No control point of {name} is selected; select some in edit mode, or hold others"
)
NO_FILE = "There is no file {name}; choose another one"
NO_LANDMARKS = "{name} has no landmarks yet; press Detect All or load a file"
NONE_FOUND = "No landmarks were found in {name}; import them from a file"
NOTHING_DETECTED = "No photo has landmarks yet; press Detect All or load a file"
NO_EDITOR = "Press Edit Landmarks first"
NO_MASK_EDITOR = "Press Paint Mask first"
NO_MASKS = "No mask is painted yet; press Paint Mask"
NO_SKIN = "{name} knows no skin masks; reconstruct it again"
STAGE_OPEN = "Press Done first: a photo is being edited"
STAGE_ELSEWHERE = "Go back to the scene {name} first: a photo is being edited there"
REPLACE_MASKS = "Other mask files are there already: replace them?"
MASKED = "The mask of {name} counts in the next run"
BAD_EDIT = "The landmarks hold {why}; undo until all points are back"
FOUND = "Faces found in {found} of {photos}"
FACES = "This photo shows {count} faces; Edit Landmarks shows which one is taken"
MOVED = "{count} landmarks were moved"
NO_CAMERA_OF = "No camera belongs to {name!r}; photos that were left out have none"
NO_PHOTO_VIEW = "No photo: free view"
LIGHT_UNSEEN = (
    "Solid shading does not show lights: choose Rendered, or Material Preview with "
    "Scene Lights"
)
NO_LIGHT = "No light was estimated for this photo"
NO_MAP = "{name} has no {map} map; reconstruct it with shading"
MESH = "A mesh of {count} quads was made"
HEAD = "A head of {count} quads was made"
NO_PICTURE = (
    "The picture {name} is not at {path}; reconstruct again, or switch Texture off"
)
NO_MAP_SHOWN = "No picture is shown on the surface; choose one under Texture"
NO_EXPRESSION = "No ticked photo has the expression {name!r}; set it in the photo list"
LONG_WORD = "A shape key cannot have the name {name!r}; use a shorter word"
RESERVED_WORD = "BSface needs the name {name!r} itself; use another word"
KEY_IS_THERE = (
    "The shape key {name!r} was not made from photos; rename or remove it, or use "
    "another word"
)
KEY = "Shape key {name} made"
WROTE = "Wrote {path}"
COPIED = "The information is in the clipboard; paste it into your report"
LEFTOVERS = "Cameras and suns of a face that was deleted are still there"
COARSE_OPEN = "The coarse net is open; press Done first"
NO_COARSE = "Press Edit a Coarse Net first"
NO_FACE_FILE = (
    "{name} has lost what BSface keeps with it (the custom property bsface_file); "
    "undo, or reconstruct it again"
)
OUT_OF_SIGHT = (
    "{name} is in a collection that is hidden or excluded from this view layer; show "
    "it in the Outliner"
)
OF_ANOTHER = "The list holds the photos of {owner}, not of {name}; select {owner}"
LINKED = (
    "{name} is linked from another file; make it local (Object > Relations > Make "
    "Local > Selected Objects and Data)"
)
NO_FILE_NAME = "{path!r} is a folder; give the file to write a name"
UNKNOWN_ENDING = "{path}: unknown ending; choose one of {kinds}"
TOGETHER = (
    "The whole net of {name} was moved or scaled since the last run, as Set Origin and "
    "Apply do, and its cameras do not fit; undo that, or press Refit, Holding None"
)
NET_SIZE = (
    "{name} has {across} x {down} control points, and a run takes {least} to {most}; "
    "press Resample first"
)
NO_AMOUNT = "The amount must be a number from 0 to 1"
NO_LANDMARK_FILE = "Choose a landmark file, its name ends in .pts or .json"
NO_SIZE = "{name} is scaled to nothing; clear its scale (Alt S)"
BAD_SIZE = "The size of the face is no finite number; press Reset in the settings"
NO_NUMBERS = (
    "{name} has control points that are no finite numbers, or all at one place; undo, "
    "or remove it"
)
TOO_FEW_POINTS = "The face has too few control points for a coarse net: {why}"
NO_LEFTOVERS = "Nothing is left of deleted faces"
REMOVED = "{count} objects of deleted faces were removed"
NO_SUCH_FILES = (
    "The photos of {name} are not in {folder} nor beside this file; add them to the "
    "list"
)
CAPTURE = (
    "10 to 40 sharp photos of one person with a calm face: from the front, and up to "
    "45 degrees from either side.",
    "Let the light change from photo to photo: its shading gives the fine shape.",
)
CHOOSING = ("Choose photos,", "or choose none:", "all of the folder are added.")
EDITING = (
    "Select points and press G to move them onto the picture. Points that you move "
    "count more than detected ones."
)
PAINTING = (
    "Tinted is what is not skin of the face. Paint over hair, hands or glasses, or "
    "over skin that was missed. Press F to change the size of the brush."
)
EXPRESSIONS = (
    "Give the photos of one expression a word, such as Smile; "
    "each word becomes a shape key."
)
MAKE_KEY = "Make Shape Key {name} ({photos})"
MISSING = (
    "The library {missing} is missing; install the BSface zip that fits this Blender "
    "and platform, not the source folder"
)
UNEXPECTED = (
    "An error inside BSface ({error}); the scene is as it was. Please copy the system "
    "information at the end of the panel into a report"
)
NO_MEMORY = "There is not enough memory; use fewer photos or fewer control points"
BAD_SETTINGS = "The settings are not usable: {why}"


def plural(count: int, noun: str) -> str:
    """``"1 photo"``, ``"2 photos"``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def quality(facts: Mapping[str, float | int | None]) -> str:
    """How well the photos fix the face, in numbers; empty where nothing is known.

    Parameters
    ----------
    facts : mapping
        See `stored_facts.quality_facts`.
    """
    if not facts:
        return ""
    parts = [f"{facts['used']} of {plural(facts['photos'], 'photo')} used"]
    if facts["deviation_mm"] is not None:
        parts.append(f"median deviation {facts['deviation_mm']:.1f} mm")
    parts.append(f"eyes {facts['eyes_px']:.0f} pixels apart")
    return "; ".join(parts) + "."


def counts(numbers):
    """The line over the photo list; what is zero or goes without saying is left out."""
    parts = [plural(numbers["all"], "photo")]
    if numbers["use"] < numbers["all"]:
        parts.append(f"{numbers['use']} ticked")
    if numbers["used"]:
        parts.append(f"{numbers['used']} used")
    if numbers["failed"]:
        parts.append(f"{numbers['failed']} with faults")
    return ", ".join(parts)


def added(count: int, given: int) -> str:
    """The sentence after adding photos."""
    if count == given:
        return f"{plural(count, 'photo')} added"
    return f"{plural(count, 'photo')} added, {given - count} in the list already"


def masks_saved(count: int, replaced: int = 0) -> str:
    """The sentence after saving masks."""
    sentence = f"{plural(count, 'mask')} written beside the photos"
    if replaced:
        sentence += f"; {plural(replaced, 'other file')} of that name replaced"
    return sentence


def keys_added(count: int, kept: int) -> str:
    """The sentence after adding shape keys."""
    sentence = f"{plural(count, 'shape key')} added"
    if kept:
        sentence += f"; {kept} that you made or changed stay as they are"
    return sentence


def done(face, reports):
    """The sentence after a run."""
    used = sum(report.status == "used" for report in reports)
    return f"{face.name}: {used} of {plural(len(reports), 'photo')} used"


def photo_status(code: str) -> tuple[str, str, str]:
    """Word, icon and advice of a photo's status; nothing is said of what is fine."""
    if code in FINE:
        return "", FINE[code], ""
    try:
        failure = FailureCode(code)
    except ValueError:  # of a file that a newer version wrote
        return code, "QUESTION", ""
    return failure.label, ICONS.get(failure, "ERROR"), ADVICE[failure]


STAGES = {
    "landmarks": "Finding faces",
    "motion": "Placing cameras",
    "refine": "Refining the surface",
    "output": "Painting the texture",
}


def progress_line(running: Job) -> str:
    """Stage of a running job, and how far it is."""
    step = running.step
    if step is None:
        return "Starting"
    line = STAGES.get(step.stage, step.stage)
    return f"{line} {step.done}/{step.total}" if step.total > 1 else line


def time_left(running: Job) -> str:
    """The time left of a running job; empty while that would be a guess."""
    left = running.remaining()
    return "" if left is None else duration(left)


def duration(seconds: float) -> str:
    """``"about 40 s left"``; minutes above a minute and a half."""
    if seconds > 90:
        return f"about {round(seconds / 60)} min left"
    return f"about {max(round(seconds), 1)} s left"


def system_information() -> str:
    """What a bug report needs, as text to paste."""
    import bpy

    lines = [
        f"BSface {extension_version()}",
        f"Blender {bpy.app.version_string} ({bpy.app.build_platform.decode()})",
        f"Python {sys.version.split()[0]}, {platform.platform()}",
    ]
    for name in ("numpy", "scipy", "cv2"):
        try:
            lines.append(f"{name} {__import__(name).__version__}")
        except ImportError as error:
            lines.append(f"{name} missing: {error}")
    if not bpy.app.background:
        try:
            import gpu

            lines.append(f"{gpu.platform.renderer_get()} {gpu.platform.version_get()}")
        except SystemError:
            lines.append("no GPU")
    return "\n".join(lines)


def extension_version() -> str:
    """Version from the extension's manifest."""
    import tomllib
    from pathlib import Path

    manifest = Path(__file__).resolve().parents[1] / "blender_manifest.toml"
    try:
        return tomllib.loads(manifest.read_text("utf-8"))["version"]
    except (OSError, KeyError, ValueError):
        return "unknown"
