#!/usr/bin/env python3
"""Flips the sign of one term of a backward function at a time and demands that a test notices.

    python3 tests/gradient/sign_flips.py --build DIR [--libraries DIR] [--only GROUP,...] [--list]

Copies of the sources with `flipped(number, term)` around the terms of flips.txt are compiled into DIR, each group of
them once, together with its tests; the tests then run once for each number (ARS_FLIP) and once without. Prints a table;
exit code 0 only where every flip fails a test and none fails without. The checkout is not touched. --libraries: where
the built libars_*.so lie (default: build/release)."""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent

# Tests and the sources that are compiled anew with them (headers with flips reach both); `torch`: needs LibTorch.
GROUPS = {
    "splat": dict(tests=["tests/unit/surfel/splat_gradient_test.cpp"],
                  sources=["engine/surfel/splat_gradient.cpp", "engine/surfel/splat_gradient_cpu.cpp"]),
    "pose": dict(tests=["tests/unit/surfel/pose_surfels_gradient_test.cpp"],
                 sources=["engine/surfel/pose_surfels_gradient.cpp"]),
    "shade": dict(tests=["tests/unit/shade/shading_gradient_test.cpp"], sources=["engine/shade/shading_gradient.cpp"]),
    "tone": dict(tests=["tests/unit/shade/tone_gradient_test.cpp"], sources=["engine/shade/tone_gradient.cpp"]),
    "radius": dict(tests=["tests/unit/occlusion/radius_gradient_test.cpp"],
                   sources=["engine/occlusion/radius_gradient.cpp"]),
    "light": dict(tests=["tests/unit/light/prefilter_gradient_test.cpp"],
                  sources=["engine/light/prefilter_gradient.cpp", "engine/light/prefilter_cpu.cpp"]),
    "operators": dict(torch=True,
                      tests=["tests/unit/model/operators_test.cpp", "tests/unit/model/operators_chain_test.cpp"],
                      sources=[f"model/operators/{name}.cpp" for name in
                               ("operator_support", "surfels", "splat", "occlusion", "shade", "tone")] +
                              ["model/device.cpp", "model/tensors.cpp"]),
    "losses": dict(torch=True, tests=["tests/unit/model/losses_test.cpp"],
                   sources=[f"model/loss/{name}.cpp" for name in
                            ("losses", "loss_chains", "geometry_losses", "normal_deformation_loss")] + ["model/tensors.cpp"]),
    "network": dict(torch=True, tests=["tests/unit/model/network_filters_test.cpp"],
                    sources=["model/network/filters.cpp", "model/network/filter_chains.cpp"]),
}
LIBRARIES = ("scene capture frame metrics shade light occlusion surfel maps rig io core").split()


class Flip:
    def __init__(self, number, group, path, tests, marked):
        self.number, self.group, self.path, self.tests = number, group, path, tests
        self.before = marked.replace("«", "").replace("»", "")
        self.after = re.sub("«(.*)»", lambda m: f"::ars::flips::flipped({number}, {m.group(1)})", marked, flags=re.S)
        self.term = re.search("«(.*)»", marked, flags=re.S).group(1)


def read_flips():
    flips, group, path, tests = [], None, None, "*"
    for line in (HERE / "flips.txt").read_text(encoding="utf-8").splitlines():
        if line.startswith("["):
            group, path, tests = (line.strip("[]").split() + ["*"])[:3]
        elif line.strip() and not line.startswith("#"):
            flips.append(Flip(len(flips), group, path, tests, line.strip()))
    return flips


def write_overlay(flips, folder):
    """Copies of the files with flips; each term must be there exactly once."""
    stale = []
    for path in sorted({flip.path for flip in flips}):
        text = (ROOT / path).read_text(encoding="utf-8")
        for flip in (f for f in flips if f.path == path):
            if text.count(flip.before) != 1:
                stale.append(f"{path}: found {text.count(flip.before)} times, expected once: {flip.before}")
                continue
            text = text.replace(flip.before, flip.after)
        target = folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        if not target.exists() or target.read_text(encoding="utf-8") != text:
            target.write_text(text, encoding="utf-8")
    if stale:
        sys.exit("flips.txt no longer fits the sources:\n" + "\n".join(stale))


def compile_one(source, overlay, build, torch):
    path = overlay / source if (overlay / source).exists() else ROOT / source
    target = build / (source.replace("/", "_") + ".o")
    newest = max(p.stat().st_mtime for p in [path, *overlay.rglob("*.h"), HERE / "flip.h"])
    if target.exists() and target.stat().st_mtime > newest:
        return target
    command = ["g++", "-std=c++20", "-O1", "-fPIC", "-fopenmp", "-ffp-contract=off", "-DFMT_SHARED",
               "-DGLM_ENABLE_EXPERIMENTAL", "-DGLM_FORCE_DEPTH_ZERO_TO_ONE", "-include", str(HERE / "flip.h"),
               f"-I{overlay}", f"-I{ROOT}", "-isystem", "/usr/include/eigen3"]
    if torch:
        include = ROOT / ".deps/torch/torch/include"
        # As the build does it: LibTorch's headers bring a fmt of their own.
        command += ["-DFMT_HEADER_ONLY=1", "-isystem", str(include), "-isystem", str(include / "torch/csrc/api/include")]
    done = subprocess.run(command + ["-c", str(path), "-o", str(target)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{source} does not compile with its flips:\n{done.stderr[:4000]}")
    return target


def build_group(name, overlay, build, libraries):
    group = GROUPS[name]
    torch = group.get("torch", False)
    objects = [compile_one(s, overlay, build, torch) for s in group["tests"] + group["sources"]]
    binary = build / f"flips_{name}"
    command = ["g++", *map(str, objects), "-o", str(binary)]
    for folder in sorted({library.parent for library in libraries.rglob("libars_*.so")}):
        command += [f"-L{folder}", f"-Wl,-rpath,{folder}"]
    command += [f"-lars_{library}" for library in LIBRARIES]
    command += [str(next(iter(libraries.rglob("libars_test_support.a"))))]
    command += ["-lfmt", "-lspdlog", "-lgtest", "-lgtest_main", "-lpthread", "-fopenmp"]
    if torch:
        lib = ROOT / ".deps/torch/torch/lib"
        command += [f"-L{lib}", f"-Wl,-rpath,{lib}", f"-Wl,-rpath-link,{lib}", "-ltorch_cpu", "-lc10"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{name} does not link:\n{done.stderr[:4000]}")
    return binary


def run(binary, number, tests="*"):
    """Where the first expectation fails, or None where none does."""
    environment = dict(os.environ, ARS_FLIP=str(number), ARS_RESOURCES=str(ROOT / "resources"))
    # The first failed expectation ends the run.
    command = [str(binary), "--gtest_fail_fast", "--gtest_throw_on_failure", f"--gtest_filter={tests}"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode == 0:
        return None
    test = re.findall(r"\[ RUN      \] (\S+)", done.stdout)
    place = re.search(r"(\w+\.(?:cpp|h):\d+): Failure", done.stdout + done.stderr)
    if not test or not place:
        sys.exit(f"flip {number}: {binary.name} ended with {done.returncode} without a failed expectation")
    return f"{test[-1]} ({place.group(1)})"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=Path, help="scratch folder")
    parser.add_argument("--libraries", type=Path, default=ROOT / "build/release", help="folder of the built program")
    parser.add_argument("--only", help="groups, with commas between")
    parser.add_argument("--list", action="store_true", help="check flips.txt against the sources and print it")
    arguments = parser.parse_args()
    names = arguments.only.split(",") if arguments.only else list(GROUPS)
    flips = [flip for flip in read_flips() if flip.group in names]
    if arguments.list:
        with tempfile.TemporaryDirectory() as folder:
            write_overlay(flips, Path(folder))
        for flip in flips:
            print(f"{flip.number:4d}  {flip.group:10s} {flip.path}: {flip.term}")
        return 0
    if not arguments.build:
        parser.error("--build is needed: a scratch folder")
    if not any(arguments.libraries.rglob("libars_surfel.so")):
        parser.error(f"no libars_surfel.so under {arguments.libraries}: build the program first")
    build, libraries = arguments.build.resolve(), arguments.libraries.resolve()
    build.mkdir(parents=True, exist_ok=True)
    unnoticed = 0
    for name in names:
        own = [flip for flip in flips if flip.group == name]
        overlay = build / f"overlay_{name}"
        write_overlay(own, overlay)
        objects = build / name
        objects.mkdir(exist_ok=True)
        binary = build_group(name, overlay, objects, libraries)
        without = run(binary, -1)
        if without:
            sys.exit(f"{name}: {without} fails without any flip")
        for flip in own:
            started = time.time()
            noticed = run(binary, flip.number, flip.tests)
            unnoticed += noticed is None
            print(f"{flip.number:4d}  {noticed or 'NOT NOTICED':84s} {time.time() - started:5.1f} s  "
                  f"{flip.path}: {flip.term}", flush=True)
    print(f"{len(flips)} flips, {len(flips) - unnoticed} noticed, {unnoticed} not")
    return 1 if unnoticed else 0


if __name__ == "__main__":
    sys.exit(main())
