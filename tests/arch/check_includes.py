"""Reads the includes of every source file and fails on a forbidden direction between rooms, on LibTorch outside model/,
on vector types other than GLM's in *_math.h, and on CUDA in headers that other rooms include.

usage: check_includes.py ROOT | --self-test
"""
import pathlib
import re
import sys
import tempfile

# Inside the engine a room may use itself and the ones before it.
ENGINE = ["core", "io", "rig", "maps", "surfel", "occlusion", "light", "shade", "metrics", "frame", "capture", "scene", "gl"]
INCLUDE = re.compile(r'^\s*#\s*include\s*[<"]([^">]+)[">]', re.M)
TORCH = re.compile(r"^(torch|ATen|c10|caffe2)/")
GL = re.compile(r"^(GL|GLES\d?|EGL|GLFW)/|^imgui_impl_")
# Where Dear ImGui's backends meet the window; no panel.
WINDOW = re.compile(r"^ui/window[a-z_]*\.cpp$")
CUDA = re.compile(r"^(cuda|cub|thrust|cooperative_groups|device_launch)")
OTHER_VECTORS = re.compile(r"^(Eigen/|unsupported/Eigen|Imath|OpenEXR/Imath|immintrin|.*mm_malloc)")


def room_of(path):
    parts = path.split("/")
    if parts[0] == "engine" and len(parts) > 2:
        return "engine/" + parts[1]
    return parts[0] if parts[0] in ("app", "ui", "model", "tests") else None


def allowed(source, target):
    """May a file of room `source` include one of room `target`?"""
    if source == target or source == "tests":
        return True
    if source == "app":
        return target != "tests"
    if source in ("ui", "model"):
        return target.startswith("engine/") and not (source == "model" and target == "engine/gl")
    if source.startswith("engine/") and target.startswith("engine/"):
        return ENGINE.index(target[7:]) <= ENGINE.index(source[7:])
    return False


def check_file(root, path):
    name = path.relative_to(root).as_posix()
    source = room_of(name)
    problems = []
    for include in INCLUDE.findall(path.read_text(encoding="utf-8")):
        target = room_of(include)
        if target and not allowed(source, target):
            problems.append(f"{name}: {source} may not include {include} (of {target})")
        if include.startswith(("../", "./")):
            problems.append(f"{name}: include \"{include}\" from the root of the repository instead")
        if TORCH.match(include) and source not in ("model", "tests"):
            problems.append(f"{name}: includes {include}; LibTorch belongs to model/ alone")
        if TORCH.match(include) and source == "model" and name.endswith(("/runtime.h", "/plugin.h")):
            problems.append(f"{name}: includes {include}; this header is for rooms without LibTorch")
        if GL.match(include) and source == "ui" and not WINDOW.match(name):
            problems.append(f"{name}: includes {include}; ui has no OpenGL of its own")
        if CUDA.match(include) and not name.endswith((".cu", ".cuh")):
            problems.append(f"{name}: includes {include}; CUDA stays in .cu files")
        if OTHER_VECTORS.match(include) and name.endswith("_math.h"):
            problems.append(f"{name}: includes {include}; *_math.h uses GLM's types alone")
    if source and source.startswith("engine/") and source[7:] not in ENGINE:
        problems.append(f"{name}: the room {source} is not on the list of design")
    return problems


def check_tree(root):
    problems, count = [], 0
    for folder in ("app", "engine", "model", "ui"):
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in (".h", ".cpp", ".cu", ".cuh"):
                count += 1
                problems += check_file(root, path)
    return problems, count


def self_test():
    """Plants one offence of every kind and expects each to be found, and a sound file to pass."""
    offences = {
        "engine/core/a.cpp": '#include "engine/io/npz.h"',
        "engine/rig/b.cpp": "#include <torch/torch.h>",
        "engine/rig/c_math.h": "#include <Eigen/Core>",
        "engine/io/d.cpp": '#include "app/info.h"',
        "engine/io/e.h": "#include <cuda_runtime.h>",
        "engine/scene/f.cpp": '#include "engine/gl/context.h"',
        "ui/g.cpp": "#include <GL/gl.h>",
        "ui/h.cpp": '#include "model/runtime.h"',
        "model/runtime.h": "#include <ATen/ATen.h>",
        "model/i.cpp": '#include "ui/panel.h"',
        "engine/io/j.cpp": '#include "../core/error.h"',
        "engine/attic/k.cpp": "",
    }
    sound = {"engine/rig/ok.cpp": '#include "engine/io/npz.h"\n#include <glm/glm.hpp>', "model/ok.cpp": "#include <torch/torch.h>",
             "app/ok.cpp": '#include "model/runtime.h"\n#include "ui/panel.h"'}
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder)
        for name, text in {**offences, **sound}.items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(text)
        found, _ = check_tree(root)
    missed = [name for name in offences if not any(p.startswith(name + ":") for p in found)]
    wrong = [p for p in found if p.split(":")[0] in sound]
    if missed or wrong:
        sys.exit(f"missed: {missed}\nwrongly reported: {wrong}")
    print(f"{len(offences)} planted offences found, {len(sound)} sound files passed")


def main():
    if sys.argv[1:] == ["--self-test"]:
        return self_test()
    problems, count = check_tree(pathlib.Path(sys.argv[1]))
    if count == 0:
        sys.exit("no source files found")
    print(f"{count} files read, {len(problems)} problems")
    sys.exit("\n".join(problems) if problems else 0)


if __name__ == "__main__":
    main()
