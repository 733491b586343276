#!/usr/bin/env python3
"""tools/convert_checkpoint.py on checkpoints with the published key names, made here without PyTorch.

    python3 test_convert_checkpoint.py
"""
import collections
import importlib.util
import io
import json
import os
import pathlib
import pickle
import struct
import subprocess
import sys
import tempfile
import types
import unittest
import zipfile

TOOL = pathlib.Path(__file__).parents[3] / "tools/convert_checkpoint.py"


def module(name):
    if name not in sys.modules:
        sys.modules[name] = types.ModuleType(name)
    return sys.modules[name]


class FloatStorage:
    pass


def _rebuild_tensor_v2(*_):
    raise AssertionError("only named in pickles")


FloatStorage.__module__, FloatStorage.__qualname__ = "torch", "FloatStorage"
_rebuild_tensor_v2.__module__ = "torch._utils"
module("torch").FloatStorage = FloatStorage
module("torch._utils")._rebuild_tensor_v2 = _rebuild_tensor_v2


class Storage:
    def __init__(self, key, values):
        self.key, self.values = key, values


class FakeTensor:
    def __init__(self, storage, offset, size, stride):
        self.parts = (storage, offset, size, stride)

    def __reduce__(self):
        return _rebuild_tensor_v2, (*self.parts, False, collections.OrderedDict())


class Pickler(pickle.Pickler):
    def persistent_id(self, value):
        if isinstance(value, Storage):
            return ("storage", FloatStorage, value.key, "cpu", len(value.values))
        return None


def save(path, content, storages):
    stream = io.BytesIO()
    Pickler(stream, protocol=2).dump(content)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("net/data.pkl", stream.getvalue())
        for storage in storages:
            archive.writestr(f"net/data/{storage.key}", struct.pack(f"<{len(storage.values)}f", *storage.values))


NAMES = ["style.1.weight", "style.2.bias", "conv_in.1.weight", "conv_in.2.bias", "from_rgbs.4.conv.0.weight",
         "from_rgbs.0.conv.1.bias", "cond_convs.0.conv1.0.weight", "cond_convs.0.conv1.1.bias",
         "cond_convs.4.conv2.1.weight", "cond_convs.4.conv2.2.bias", "comb_convs.5.0.weight", "comb_convs.0.1.bias",
         "convs1.11.conv.weight", "convs2.0.conv.modulation.weight", "convs2.0.conv.modulation.bias",
         "convs1.3.noise.weight", "convs1.3.activate.bias", "to_rgbs2.5.conv.weight",
         "to_rgbs2.5.conv.modulation.weight", "to_rgbs1.0.bias", "noises.noise_11"]
CONSTANTS = ["conv_in.0.kernel", "convs1.0.conv.blur.kernel", "iwt.ll", "to_rgbs1.1.upsample.kernel"]


def checkpoint():
    storages, state = [], collections.OrderedDict()

    def add(name):
        storage = Storage(str(len(storages)), [len(storages) + i / 8 for i in range(6)])
        storages.append(storage)
        state[name] = FakeTensor(storage, 0, (2, 3), (3, 1))

    for net in ("color_net.", "position_net.", "other_net."):
        for name in NAMES + CONSTANTS:
            add(net + name)
    for name in ("0.weight", "0.bias", "2.weight", "2.bias"):
        add("viewdir_net." + name)
    return {"epoch_idx": 3, "iter_idx": 700, "avatar_net": state}, storages


def read(path):
    raw = path.read_bytes()
    size, = struct.unpack("<Q", raw[:8])
    header = json.loads(raw[8:8 + size])
    header.pop("__metadata__")
    return {n: (e["shape"], struct.unpack("<6f", raw[8 + size + e["data_offsets"][0]:8 + size + e["data_offsets"][1]]))
            for n, e in header.items()}


class ConvertCheckpoint(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.source = pathlib.Path(self.folder.name) / "net.pt"
        self.target = pathlib.Path(self.folder.name) / "weights.safetensors"

    def convert(self):
        return subprocess.run([sys.executable, TOOL, self.source, self.target], capture_output=True, text=True)

    def test_every_learned_tensor_arrives_under_its_new_name(self):
        content, storages = checkpoint()
        save(self.source, content, storages)
        done = self.convert()
        self.assertEqual(done.returncode, 0, done.stderr)
        found = read(self.target)
        expected = {n + name for n in ("color.", "position.", "other.") for name in NAMES}
        expected |= {f"view_encoder.{i}.{w}" for i in (0, 2) for w in ("weight", "bias")}
        self.assertEqual(set(found), expected)
        for old, tensor in content["avatar_net"].items():
            new = old.replace("viewdir_net", "view_encoder").replace("_net", "")
            if new in found:
                self.assertEqual(found[new], ([2, 3], tuple(tensor.parts[0].values)))

    def test_strided_tensors_become_contiguous(self):
        content, storages = checkpoint()
        storage = storages[0]
        content["avatar_net"]["color_net.style.1.weight"] = FakeTensor(storage, 0, (2, 3), (1, 2))
        save(self.source, content, storages)
        self.assertEqual(self.convert().returncode, 0)
        v = storage.values
        self.assertEqual(read(self.target)["color.style.1.weight"][1], (v[0], v[2], v[4], v[1], v[3], v[5]))

    def refused(self, sentence):
        done = self.convert()
        self.assertEqual(done.returncode, 1)
        self.assertIn(sentence, done.stderr)
        self.assertEqual(len(done.stderr.strip().splitlines()), 1, done.stderr)
        self.assertFalse(self.target.exists())

    def test_code_in_a_pickle_is_refused_by_name(self):
        content, storages = checkpoint()

        class Hostile:
            def __reduce__(self):
                return os.system, ("true",)

        content["extra"] = Hostile()
        save(self.source, content, storages)
        self.refused("found posix.system")

    def test_other_files_are_refused(self):
        self.source.write_bytes(b"not a checkpoint")
        self.refused("expected a zip")
        content, storages = checkpoint()
        save(self.source, {"model": 1}, storages)
        self.refused("expected a dictionary with avatar_net")

    def test_a_tensor_beyond_its_storage_is_refused(self):
        content, storages = checkpoint()
        content["avatar_net"]["color_net.style.1.weight"] = FakeTensor(storages[0], 2, (2, 3), (3, 1))
        save(self.source, content, storages)
        self.refused("reaches beyond its storage")

    def test_a_missing_network_is_named(self):
        content, storages = checkpoint()
        content["avatar_net"] = {n: t for n, t in content["avatar_net"].items() if not n.startswith("other_net")}
        save(self.source, content, storages)
        self.refused("no tensors of other_net.")


if __name__ == "__main__":
    unittest.main()
