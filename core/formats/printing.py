"""Files for 3D printers: STL (binary) and 3MF, millimetres, one closed solid each.

References: 3D Systems, StereoLithography Interface Specification, 1989; 3MF Consortium,
3D Manufacturing Format Core Specification 1.3. Equal solids give equal bytes.
"""

from __future__ import annotations

import io
import os
import zipfile
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from .._types import Array, Indices
from ..files import write_bytes

_TYPES = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" '
    'ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" '
    'ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>'
    "</Types>\n"
)
_RELATIONS = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<Relationships '
    'xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    '<Relationship Target="/3D/3dmodel.model" Id="rel0" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>'
    "</Relationships>\n"
)


def write_stl(
    path: str | os.PathLike, points: Array, triangles: Indices, name: str = "face"
) -> Path:
    """Write triangles as binary STL.

    Parameters
    ----------
    path : path-like
    points : (p, 3) array
        mm; STL itself names no unit.
    triangles : (t, 3) int array
    name : str

    Raises
    ------
    ReconstructionError
        When the file cannot be written.
    """
    # Rounded first: the normals belong to the numbers in the file.
    corner = points.astype("<f4")[triangles]
    normal = np.cross(
        (corner[:, 1] - corner[:, 0]).astype(float),
        (corner[:, 2] - corner[:, 0]).astype(float),
    )
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    record = np.zeros(
        len(triangles), [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("extra", "<u2")]
    )
    record["n"], record["v"] = normal, corner
    # A header that begins with "solid" is taken for the text form.
    title = f"bsface {name}, millimetres".encode("ascii", "replace")[:80]
    head = title.ljust(80) + np.uint32(len(triangles)).tobytes()
    return write_bytes(path, head + record.tobytes())


def write_3mf(
    path: str | os.PathLike, points: Array, triangles: Indices, name: str = "face"
) -> Path:
    """Write triangles as 3MF; parameters and errors as in :func:`write_stl`."""
    vertices = "".join(
        f'<vertex x="{x:.6g}" y="{y:.6g}" z="{z:.6g}"/>\n'
        for x, y, z in points.tolist()
    )
    faces = "".join(
        f'<triangle v1="{a}" v2="{b}" v3="{c}"/>\n' for a, b, c in triangles.tolist()
    )
    plain = "".join(c for c in name if c.isprintable())
    model = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<model unit="millimeter" xml:lang="en-US" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">\n'
        '<metadata name="Application">bsface</metadata>\n<resources>\n'
        f'<object id="1" type="model" name={quoteattr(plain)}>\n<mesh>\n'
        f"<vertices>\n{vertices}</vertices>\n<triangles>\n{faces}</triangles>\n"
        '</mesh>\n</object>\n</resources>\n<build>\n<item objectid="1"/>\n</build>\n'
        "</model>\n"
    )
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as target:
        for member, text in (
            ("[Content_Types].xml", _TYPES),
            ("_rels/.rels", _RELATIONS),
            ("3D/3dmodel.model", model),
        ):
            info = zipfile.ZipInfo(member, date_time=(1980, 1, 1, 0, 0, 0))
            info.compress_type = zipfile.ZIP_DEFLATED
            info.create_system = 3
            target.writestr(info, text.encode("utf-8"), compresslevel=6)
    return write_bytes(path, archive.getvalue())
