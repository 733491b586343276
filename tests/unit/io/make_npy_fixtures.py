"""Writes fixtures/npy/: small .npy and .npz files made by numpy, and expected.json with what numpy reads from them.

    python make_npy_fixtures.py

Needs numpy 2 and the zip tool. The files are stored; this script is how they came to be.
"""

import json
import pickle
import subprocess
import zipfile
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parent / "fixtures" / "npy"
EXTREMES = {
    "b1": [True, False, True, True],
    "i1": [-128, 127], "i2": [-32768, 32767], "i4": [-(2**31), 2**31 - 1], "i8": [-(2**63), 2**63 - 1],
    "u1": [0, 255], "u2": [0, 65535], "u4": [0, 2**32 - 1], "u8": [0, 2**64 - 1],
    "f2": [65504.0, -6.103515625e-05, np.inf, 5.9604644775390625e-08],
    "f4": [3.4028234663852886e38, -np.inf, 1e-45, -0.1],
    "f8": [1.7976931348623157e308, np.inf, 5e-324, -0.1],
    "c8": [1.5 - 2.5j, -3.25j], "c16": [0.1 - 0.2j, 1e300 + 1e-300j],
}
expected = {}


def plain(value):
    """A value as JSON can hold it: complex numbers as pairs, what is not finite as text."""
    if isinstance(value, complex):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, bytes):
        return value.decode("latin-1")
    if isinstance(value, float) and not np.isfinite(value):
        return repr(value)
    return value


def describe(array):
    return {"dtype": "text" if array.dtype.kind in "US" else array.dtype.name, "shape": list(array.shape),
            "values": [plain(v) for v in array.ravel(order="C").tolist()]}


def save(name, array, version=None):
    with open(FOLDER / name, "wb") as file:
        np.lib.format.write_array(file, array, version=version)
    expected[name] = describe(np.load(FOLDER / name))


def sample(kind, shape):
    """A ramp with the extreme values of the type at the front."""
    values = np.arange(int(np.prod(shape))).astype(kind)
    if kind == "b1":
        values = np.arange(int(np.prod(shape))) % 3 == 0
    extremes = np.array(EXTREMES[kind], dtype=kind)[: values.size]
    values[: extremes.size] = extremes
    return values.reshape(shape)


def make_arrays():
    for kind in EXTREMES:
        save(f"{kind}_c.npy", sample(kind, (2, 3)))
        big = sample(kind, (2, 3, 4, 5)[: 4 if kind == "f4" else 3]).astype(np.dtype(kind).newbyteorder(">"))
        save(f"{kind}_fortran_big.npy", np.asfortranarray(big))
    save("version2.npy", np.arange(3.0), version=(2, 0))
    save("version3.npy", np.arange(4.0), version=(3, 0))
    save("scalar.npy", np.array(2.5))
    save("empty.npy", np.zeros((0, 3), np.int32))
    save("nan.npy", np.array([np.nan, 1.0, -np.inf]))
    save("unicode.npy", np.array([["Hüfte", "膝", "🦴"], ["", "left_knee", "a b"]]))
    save("unicode_big_fortran.npy", np.asfortranarray(np.array([["eins", "zwei"], ["drei", "vier"]], dtype=">U4")))
    save("bytes.npy", np.array([b"pelvis", b"", b"left_hip"]))
    save("latin1.npy", np.array([b"H\xfcfte"]))
    save("empty_texts.npy", np.array(["", ""], dtype="U0"))


def make_refused():
    np.save(FOLDER / "object.npy", np.array([{"a": 1}, None], dtype=object), allow_pickle=True)
    np.save(FOLDER / "structured.npy", np.zeros(2, dtype=[("x", "f4"), ("y", "i2")]))
    np.save(FOLDER / "date.npy", np.array(["2026-01-01"], dtype="datetime64[D]"))
    np.save(FOLDER / "long_double.npy", np.zeros(2, dtype=np.longdouble))
    np.save(FOLDER / "void.npy", np.zeros(2, dtype="V3"))
    (FOLDER / "body.pkl").write_bytes(pickle.dumps({"v_template": [0.0]}, protocol=2))


def describe_npz(name):
    with np.load(FOLDER / name) as file:
        expected[name] = {key: describe(file[key]) for key in file.files}


def make_archives():
    arrays = {"poses": np.arange(12, dtype=np.float32).reshape(4, 3), "names": np.array(["a", "bc"]),
              "tree": np.array([[-1, 0], [0, 1]])}
    np.savez(FOLDER / "stored.npz", **arrays)
    np.savez_compressed(FOLDER / "deflated.npz", **arrays)
    np.savez(FOLDER / "no_arrays.npz")
    for name in ("stored.npz", "deflated.npz", "no_arrays.npz"):
        describe_npz(name)
    # 64-bit records in small files: the threshold is lowered while they are written.
    limits = zipfile.ZIP64_LIMIT, zipfile.ZIP_FILECOUNT_LIMIT
    zipfile.ZIP64_LIMIT, zipfile.ZIP_FILECOUNT_LIMIT = 100, 1
    np.savez(FOLDER / "zip64.npz", **arrays)
    zipfile.ZIP64_LIMIT, zipfile.ZIP_FILECOUNT_LIMIT = limits
    describe_npz("zip64.npz")
    np.savez(FOLDER / "with_objects.npz", betas=np.zeros(10, np.float32), part2num=np.array({"head": 0}, dtype=object))


def make_unusual_archives():
    npy = (FOLDER / "f4_c.npy").read_bytes()
    with zipfile.ZipFile(FOLDER / "folders.npz", "w") as file:
        file.comment = b"a comment at the end"
        file.writestr("readme.txt", "not an array")
        file.writestr("body/left/knee.npy", npy)
        file.writestr("Hüfte.npy", npy)
        file.writestr("other.bin", b"x", compress_type=zipfile.ZIP_BZIP2)
    with zipfile.ZipFile(FOLDER / "methods.npz", "w") as file:
        file.writestr("plain.npy", npy)
        file.writestr("bzip2.npy", npy, compress_type=zipfile.ZIP_BZIP2)
        file.writestr("lzma.npy", npy, compress_type=zipfile.ZIP_LZMA)
    with zipfile.ZipFile(FOLDER / "documents.npz", "w") as file:
        file.writestr("word/document.xml", "<xml/>")
    # The zip tool cannot seek in a pipe: sizes and checksum stand behind the data.
    streamed = subprocess.run(["zip", "-q", "-X", "-", "f4_c.npy"], cwd=FOLDER, check=True, stdout=subprocess.PIPE)
    (FOLDER / "streamed.npz").write_bytes(streamed.stdout)
    (FOLDER / "encrypted.npz").unlink(missing_ok=True)
    subprocess.run(["zip", "-q", "-X", "-P", "secret", "encrypted.npz", "f4_c.npy"], cwd=FOLDER, check=True)


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    make_arrays()
    make_refused()
    make_archives()
    make_unusual_archives()
    (FOLDER / "expected.json").write_text(json.dumps(expected, ensure_ascii=False, indent=0) + "\n")
