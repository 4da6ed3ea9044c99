"""dlib's face recognition network, read from dlib's own file and run by OpenCV.

The network is ``dlib_face_recognition_resnet_model_v1`` by Davis King (public domain):
a ResNet with 29 convolutions and half as many filters as ResNet-34 (He, Zhang, Ren,
Sun 2016). It maps a picture of 150 x 150 pixels of one upright face to 128 numbers.
Pictures of one person lie within a ball of radius 0.6 of each other; on the LFW
benchmark 99.4 % of pairs of photos are told rightly by that distance. None of the
people of that benchmark was in the training data.

OpenCV does not read dlib's format, so the weights are written into an ONNX model in
memory, which it does read. Every number of the file is used as it is; the scale and
offset that follow each convolution are multiplied into it.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import ReconstructionError

Weights = NDArray[np.float32]

SIDE = 150  # pixels of the picture that the network reads
LENGTH = 128  # numbers of the descriptor
# Of the pictures that the network was trained on; part of the file, too.
MEAN_RGB = np.array([122.782, 117.001, 104.298], np.float32)
CONVOLUTIONS = 29
_CONVOLUTION, _AFFINE, _FULLY_CONNECTED = b"\x05con_4", b"\x07affine_", b"\x04fc_2"


@dataclass(frozen=True, eq=False)
class Convolution:
    """One convolution with bias.

    Parameters
    ----------
    weight : (out, in, side, side) float32 array
    bias : (out,) float32 array
    stride, padding : int
        Pixels, along both axes.
    """

    weight: Weights
    bias: Weights
    stride: int
    padding: int


class FaceNetwork:
    """The network, loaded.

    Parameters
    ----------
    path : Path
        ``dlib_face_recognition_resnet_model_v1.dat``.

    Raises
    ------
    ReconstructionError
        If the file cannot be read or is another network.
    """

    def __init__(self, path: Path) -> None:
        try:
            convolutions, last = read_weights(path.read_bytes())
        except (OSError, ValueError, struct.error) as error:
            raise ReconstructionError(
                f"{path} is damaged or is not the expected model file ({error}); "
                "remove it and fetch it again by `bsface models fetch`."
            ) from None
        model = np.frombuffer(onnx_model(convolutions, last), np.uint8)
        self._net = cv2.dnn.readNetFromONNX(model)

    def describe(self, picture: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Descriptor (128,) of a picture (150, 150, 3) of a face, RGB.

        It is the mean over the picture and its mirror image.
        """
        planes = (picture.astype(np.float32) - MEAN_RGB) / 256
        total = np.zeros(LENGTH)
        for view in (planes, planes[:, ::-1]):
            self._net.setInput(np.ascontiguousarray(view.transpose(2, 0, 1)[None]))
            total += self._net.forward().reshape(LENGTH)
        return total / 2


def read_weights(data: bytes) -> tuple[list[Convolution], Weights]:
    """Convolutions and the last, fully connected layer (256, 128) of dlib's file.

    Raises
    ------
    ValueError
        If the bytes are not this network.
    """
    reader = _DlibReader(data)
    convolutions = []
    for _ in range(CONVOLUTIONS):
        reader.skip_past(_CONVOLUTION)
        weight = reader.tensor()
        out, high, wide, stride, _, padding, _ = (reader.integer() for _ in range(7))
        reader.skip_past(_AFFINE)
        scale = reader.tensor()
        if high != wide or scale.size != 2 * out:
            raise ValueError("the layers do not fit each other")
        gamma, beta = scale[:out], scale[out:]
        kernel = weight[:-out].reshape(out, -1, high, wide)
        convolutions.append(
            Convolution(
                kernel * gamma[:, None, None, None],
                weight[-out:] * gamma + beta,
                stride,
                padding,
            )
        )
    reader.skip_past(_FULLY_CONNECTED)
    outputs, inputs = reader.integer(), reader.integer()
    last = reader.tensor()
    if outputs != LENGTH or inputs != len(convolutions[-1].bias):
        raise ValueError("the last layer is another one")
    return convolutions, last.reshape(inputs, outputs)


class _DlibReader:
    """Numbers in dlib's serialisation.

    An integer is one byte with its length, then its bytes, the lowest first. A tensor
    is the integer 2, four integers for its shape, then floats of four bytes.
    """

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def skip_past(self, name: bytes) -> None:
        found = self.data.find(name, self.at)
        if found < 0:
            raise ValueError(f"it holds no further layer {name[1:].decode()}")
        self.at = found + len(name)

    def integer(self) -> int:
        length = self.data[self.at] & 0x7F if self.at < len(self.data) else 0
        number = self.data[self.at + 1 : self.at + 1 + length]
        if not 0 < len(number) <= 8:
            raise ValueError("a number is cut off")
        self.at += 1 + length
        return int.from_bytes(number, "little")

    def tensor(self) -> Weights:
        if self.integer() != 2:
            raise ValueError("it is of another version")
        size = int(np.prod([self.integer() for _ in range(4)]))
        if not 0 < 4 * size <= len(self.data) - self.at:
            raise ValueError("it ends too early")
        values = np.frombuffer(self.data, "<f4", size, self.at)
        self.at += 4 * size
        return values.astype(np.float32)


def onnx_model(convolutions: Sequence[Convolution], last: Weights) -> bytes:
    """The network as an ONNX model: input ``picture``, output ``descriptor``.

    After the first convolution come blocks of two, each added to what went in. Where
    the first of a block has stride 2, what went in is the mean of 2 x 2 pixels; where
    the two then differ in size, the smaller is filled up with zeros at its end.
    """
    graph = _Graph()
    first, *rest = convolutions
    x = graph.node("Relu", graph.convolution("picture", first))
    x = graph.node("MaxPool", x, kernel_shape=(3, 3), strides=(2, 2))
    channels, side = len(first.bias), _pooled(_size(SIDE, first), 3)
    for one, two in zip(rest[::2], rest[1::2], strict=True):
        y = graph.convolution(graph.node("Relu", graph.convolution(x, one)), two)
        inner, out = _size(_size(side, one), two), len(two.bias)
        if one.stride == 2:
            x = graph.node("AveragePool", x, kernel_shape=(2, 2), strides=(2, 2))
            side = _pooled(side, 2)
        larger = max(side, inner)
        x = graph.padded(x, max(out - channels, 0), larger - side)
        y = graph.padded(y, max(channels - out, 0), larger - inner)
        channels, side = max(channels, out), larger
        x = graph.node("Relu", graph.node("Add", x, y))
    x = graph.node("GlobalAveragePool", x)
    full = Convolution(
        np.ascontiguousarray(last.T)[:, :, None, None],
        np.zeros(last.shape[1], np.float32),
        1,
        0,
    )
    return graph.model("picture", (1, 3, SIDE, SIDE), graph.convolution(x, full))


def _size(side: int, layer: Convolution) -> int:
    return (side + 2 * layer.padding - layer.weight.shape[2]) // layer.stride + 1


def _pooled(side: int, kernel: int) -> int:
    return (side - kernel) // 2 + 1


class _Graph:
    """An ONNX graph in the making; names are numbers. Fields as in ``onnx.proto``."""

    def __init__(self) -> None:
        self.nodes: list[bytes] = []
        self.constants: list[bytes] = []
        self.count = 0

    def node(self, kind: str, *inputs: str, **attributes: Sequence[int]) -> str:
        """Name of the output of a new node."""
        self.count += 1
        name = str(self.count)
        # AttributeProto: name 1, ints 8, type 20 (7 = INTS).
        parts = [
            _message({1: [key], 8: list(value), 20: [7]})
            for key, value in attributes.items()
        ]
        fields = {1: list(inputs), 2: [name], 3: [name], 4: [kind], 5: parts}
        self.nodes.append(_message(fields))
        return name

    def convolution(self, x: str, layer: Convolution) -> str:
        side, stride = layer.weight.shape[2], layer.stride
        return self.node(
            "Conv",
            x,
            self.constant(layer.weight),
            self.constant(layer.bias),
            kernel_shape=(side, side),
            strides=(stride, stride),
            pads=(layer.padding,) * 4,
        )

    def padded(self, x: str, channels: int, pixels: int) -> str:
        """With zeros after the last channel, row and column."""
        if channels == pixels == 0:
            return x
        return self.node("Pad", x, pads=(0, 0, 0, 0, 0, channels, pixels, pixels))

    def constant(self, values: Weights) -> str:
        self.count += 1
        name = str(self.count)
        # TensorProto: dims 1, data_type 2 (1 = FLOAT), name 8, raw_data 9.
        raw = np.ascontiguousarray(values, "<f4").tobytes()
        fields = {1: list(values.shape), 2: [1], 8: [name], 9: [raw]}
        self.constants.append(_message(fields))
        return name

    def model(self, name: str, shape: Sequence[int], output: str) -> bytes:
        """ModelProto: ir_version 1, graph 7, opset_import 8."""
        graph = {
            1: self.nodes,
            2: ["faces"],
            5: self.constants,
            11: [_value_info(name, shape)],
            12: [_value_info(output, (1, LENGTH, 1, 1))],
        }
        # Operators as of version 10: the last in which padding is an attribute.
        return _message({1: [6], 7: [_message(graph)], 8: [_message({2: [10]})]})


def _value_info(name: str, shape: Sequence[int]) -> bytes:
    """ValueInfoProto: name 1, type 2, which is a tensor: elem_type 1, shape 2."""
    dimensions = _message({1: [_message({1: [n]}) for n in shape]})
    return _message(
        {1: [name], 2: [_message({1: [_message({1: [1], 2: [dimensions]})]})]}
    )


def _message(fields: Mapping[int, Iterable[int | str | bytes]]) -> bytes:
    """A message of Protocol Buffers: numbers as varints, the rest with its length."""
    parts = []
    for number, values in fields.items():
        for value in values:
            if isinstance(value, int):
                parts.append(_varint(number << 3) + _varint(value))
            else:
                data = value.encode() if isinstance(value, str) else value
                parts.append(_varint(number << 3 | 2) + _varint(len(data)) + data)
    return b"".join(parts)


def _varint(number: int) -> bytes:
    out = bytearray()
    while number > 0x7F:
        out.append(number & 0x7F | 0x80)
        number >>= 7
    out.append(number)
    return bytes(out)
