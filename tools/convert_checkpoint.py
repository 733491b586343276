#!/usr/bin/env python3
"""Converts a checkpoint of Animatable Gaussians (net.pt) to the weights file of the preset `paper`.

    tools/convert_checkpoint.py net.pt weights.safetensors

Needs Python 3.9 or newer and nothing else: the file is a zip with a pickle, and only tensors, numbers, texts and plain
containers are unpickled; anything else is refused by name, so a hostile file runs nothing. Networks become color.*, position.*,
other.* and view_encoder.*; filter kernels, which are constants, are left out. There is no material network in such a
checkpoint, and its networks see the front position map alone and no priors.
"""
import argparse
import collections
import io
import json
import os
import pickle
import re
import struct
import sys
import zipfile

# Storage class of PyTorch: type in safetensors, bytes of a number.
STORAGES = {
    "DoubleStorage": ("F64", 8), "FloatStorage": ("F32", 4), "HalfStorage": ("F16", 2), "BFloat16Storage": ("BF16", 2),
    "LongStorage": ("I64", 8), "IntStorage": ("I32", 4), "ShortStorage": ("I16", 2), "CharStorage": ("I8", 1),
    "ByteStorage": ("U8", 1), "BoolStorage": ("BOOL", 1),
}
PREFIXES = {"color_net.": "color.", "position_net.": "position.", "other_net.": "other.", "viewdir_net.": "view_encoder."}
LEARNED = re.compile(
    r"(style\.\d+\.(weight|bias)|conv_in\.1\.weight|conv_in\.2\.bias|from_rgbs\.\d+\.conv\.(0\.weight|1\.bias)"
    r"|cond_convs\.\d+\.conv1\.(0\.weight|1\.bias)|cond_convs\.\d+\.conv2\.(1\.weight|2\.bias)"
    r"|comb_convs\.\d+\.(0\.weight|1\.bias)"
    r"|convs[12]\.\d+\.(conv\.weight|conv\.modulation\.(weight|bias)|noise\.weight|activate\.bias)"
    r"|to_rgbs[12]\.\d+\.(conv\.weight|conv\.modulation\.(weight|bias)|bias)|noises\.noise_\d+|[02]\.(weight|bias))")
CONSTANT = re.compile(r".*(kernel|\.(ll|lh|hl|hh))$")


class Refused(Exception):
    """One sentence for a person."""


class Tensor:
    """Bytes of a contiguous tensor."""

    def __init__(self, dtype, shape, data):
        self.dtype, self.shape, self.data = dtype, shape, data


def rebuild_tensor(storage, offset, size, stride, *_):
    dtype, width, data = storage
    size, stride = tuple(size), tuple(stride)
    if len(size) != len(stride) or offset < 0 or any(n < 0 for n in size + stride):
        raise Refused(f"a tensor of size {size} with strides {stride} from {offset}")
    count = 1
    for n in size:
        count *= n
    last = offset + sum((n - 1) * s for n, s in zip(size, stride))
    if count and (last + 1) * width > len(data):
        raise Refused(f"a tensor of size {size} reaches beyond its storage")
    plain, step = [], 1
    for n in reversed(size):
        plain.append(step)
        step *= n
    if count == 0 or all(n == 1 or s == p for n, s, p in zip(size, stride, reversed(plain))):
        return Tensor(dtype, size, bytes(data[offset * width:(offset + count) * width]))
    out = bytearray()
    index = [0] * len(size)
    for _element in range(count):
        at = (offset + sum(i * s for i, s in zip(index, stride))) * width
        out += data[at:at + width]
        for axis in reversed(range(len(size))):
            index[axis] += 1
            if index[axis] < size[axis]:
                break
            index[axis] = 0
    return Tensor(dtype, size, bytes(out))


class RestrictedUnpickler(pickle.Unpickler):
    def __init__(self, stream, archive, root):
        super().__init__(stream, encoding="utf-8")
        self.archive, self.root, self.storages = archive, root, {}

    def find_class(self, module, name):
        if module == "torch" and name in STORAGES:
            return name
        if (module, name) == ("collections", "OrderedDict"):
            return collections.OrderedDict
        if module == "torch._utils" and name in ("_rebuild_tensor", "_rebuild_tensor_v2"):
            return rebuild_tensor
        if (module, name) == ("torch._utils", "_rebuild_parameter"):
            return lambda tensor, *_: tensor
        raise Refused(f"expected tensors and plain containers, found {module}.{name}")

    def persistent_load(self, identifier):
        if not (isinstance(identifier, tuple) and len(identifier) == 5 and identifier[0] == "storage"):
            raise Refused(f"expected a storage, found {identifier!r:.80}")
        _, kind, key, _, count = identifier
        if kind not in STORAGES:
            raise Refused(f"expected a known storage, found {kind!r:.80}")
        if key not in self.storages:
            dtype, width = STORAGES[kind]
            data = self.archive.read(f"{self.root}data/{key}")
            if len(data) != count * width:
                raise Refused(f"storage {key}: expected {count * width} bytes, found {len(data)}")
            self.storages[key] = (dtype, width, data)
        return self.storages[key]


def read_checkpoint(path):
    """The object in a file that torch.save wrote (the zip form of PyTorch 1.6 and later)."""
    if not zipfile.is_zipfile(path):
        raise Refused("expected a zip as torch.save writes since PyTorch 1.6; older files: load and save them again")
    with zipfile.ZipFile(path) as archive:
        names = [n for n in archive.namelist() if n.endswith("data.pkl")]
        if len(names) != 1:
            raise Refused(f"expected one data.pkl, found {len(names)}")
        root = names[0][:-len("data.pkl")]
        order = root + "byteorder"
        if order in archive.namelist() and archive.read(order) != b"little":
            raise Refused("expected little endian numbers")
        return RestrictedUnpickler(io.BytesIO(archive.read(names[0])), archive, root).load()


def converted(checkpoint):
    """Tensors under this program's names."""
    if not isinstance(checkpoint, dict) or not isinstance(checkpoint.get("avatar_net"), dict):
        raise Refused("expected a dictionary with avatar_net, as Animatable Gaussians' net.pt")
    result = {}
    for name, value in checkpoint["avatar_net"].items():
        prefix = next((p for p in PREFIXES if name.startswith(p)), None)
        if prefix is None or not isinstance(value, Tensor):
            continue
        rest = name[len(prefix):]
        if LEARNED.fullmatch(rest):
            result[PREFIXES[prefix] + rest] = value
        elif not CONSTANT.fullmatch(rest):
            raise Refused(f"{name}: no such tensor in a dual StyleUNet")
    missing = [p for p in PREFIXES if not any(n.startswith(PREFIXES[p]) for n in result)]
    if missing:
        raise Refused("no tensors of " + ", ".join(missing))
    return result


def write_safetensors(path, tensors, metadata):
    header, offset = {"__metadata__": metadata}, 0
    for name in sorted(tensors):
        tensor = tensors[name]
        header[name] = {"dtype": tensor.dtype, "shape": list(tensor.shape),
                        "data_offsets": [offset, offset + len(tensor.data)]}
        offset += len(tensor.data)
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    temporary = f"{path}.{os.getpid()}.tmp"
    try:
        with open(temporary, "wb") as file:
            file.write(struct.pack("<Q", len(text)) + text)
            for name in sorted(tensors):
                file.write(tensors[name].data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        if os.path.exists(temporary):
            os.unlink(temporary)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint")
    parser.add_argument("out")
    arguments = parser.parse_args()
    try:
        tensors = converted(read_checkpoint(arguments.checkpoint))
        write_safetensors(arguments.out, tensors, {"source": "Animatable Gaussians checkpoint"})
    except (Refused, OSError, KeyError, ValueError, TypeError, EOFError, zipfile.BadZipFile, pickle.UnpicklingError) as error:
        print(f"{arguments.checkpoint}: {error}", file=sys.stderr)
        return 1
    numbers = sum(len(t.data) for t in tensors.values())
    print(f"{arguments.out}: {len(tensors)} tensors, {numbers / 2**20:.1f} MiB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
