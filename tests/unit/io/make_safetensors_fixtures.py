"""Writes fixtures/safetensors/: small files made by the `safetensors` package, and expected.json with what they hold.

    python make_safetensors_fixtures.py

Needs numpy 2 and safetensors (0.8). The files are stored; this script is how they came to be.
"""

import json
from pathlib import Path

import numpy as np
from safetensors import TensorSpec, serialize
from safetensors.numpy import load_file, save_file

FOLDER = Path(__file__).parent / "fixtures" / "safetensors"
NUMPY_TYPES = ["bool", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64", "float16", "float32",
               "float64", "complex64"]


def serialize_one(dtype, words):
    """A file with the one tensor `w` of a type that numpy has not; `words` holds its bits."""
    spec = TensorSpec(dtype=dtype, shape=[words.size], data_ptr=words.ctypes.data, data_len=words.nbytes)
    return serialize({"w": spec})


def plain(value):
    return [value.real, value.imag] if isinstance(value, complex) else value


def describe(array):
    return {"dtype": array.dtype.name, "shape": list(array.shape), "values": [plain(v) for v in array.ravel().tolist()]}


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    tensors = {f"net.{name}": (np.arange(6) % 5).astype(name).reshape(2, 3) for name in NUMPY_TYPES}
    tensors["scalar"] = np.array(-1.5, np.float32)
    tensors["empty"] = np.zeros((0, 4), np.float32)
    save_file(tensors, FOLDER / "types.safetensors", metadata={"format": "pt", "größe": "klein"})
    expected = {"types.safetensors": {key: describe(value)
                                      for key, value in load_file(FOLDER / "types.safetensors").items()}}
    # bfloat16 is the upper half of float32; 1.0, -2.5 and 3.140625 are exact in it.
    values = np.array([1.0, -2.5, 3.140625], np.float32)
    half = (values.view(np.uint32) >> 16).astype(np.uint16)
    (FOLDER / "bfloat16.safetensors").write_bytes(serialize_one("bfloat16", half))
    expected["bfloat16.safetensors"] = {"w": {"dtype": "bfloat16", "shape": [3], "values": values.tolist()}}
    (FOLDER / "float8.safetensors").write_bytes(serialize_one("float8_e4m3fn", np.array([0x38, 0x40], np.uint8)))
    (FOLDER / "expected.json").write_text(json.dumps(expected, ensure_ascii=False, indent=0) + "\n")
