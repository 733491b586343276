#!/usr/bin/env python3
"""Makes the stored answers that body_model_test.cpp compares with: the PyPI package `smplx` on two bodies.

    python3 -m venv venv && venv/bin/pip install smplx torch numpy
    venv/bin/python tests/unit/rig/smplx_compare.py

Writes into tests/unit/rig/fixtures/:
  generated_smplx.npz   a body in SMPL-X's format, 400 vertices: random mesh, weights, shape, expression, pose blend shapes
                        and hand means, all non-zero; uint32 kinematic tree with 2^32-1 as the root's parent, float64
  smplx_answers.npz     51 poses, shapes and expressions, and what smplx answers for them: all joints (metres), every
                        second vertex of the generated body, 200 vertices of the open body (resources/bodies)

and tests/fuzz/seeds/body/four_vertices.npz, a sound file to start fuzzing from.

smplx runs in float64 without PCA hands. The generated body is evaluated with flat_hand_mean both ways.
"""
import pathlib
import tempfile

import numpy as np
import smplx
import torch

HERE = pathlib.Path(__file__).resolve().parent
OPEN_BODY = HERE.parents[2] / "resources" / "bodies" / "open_body.npz"
FIXTURES = HERE / "fixtures"
SEEDS = HERE.parents[1] / "fuzz" / "seeds" / "body"
POSES = 51  # 50 random ones and the rest pose
OPEN_VERTICES = 200
PARENTS = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 15, 15, 15]
for wrist, first in ((20, 25), (21, 40)):
    PARENTS += [wrist if k % 3 == 0 else first + k - 1 for k in range(15)]


def generated_body(random, count):
    """Points around the open body's joints, every table of the format filled with something."""
    body = np.load(OPEN_BODY)
    joints = body["J_regressor"].astype(float) @ body["v_template"]
    near = random.integers(0, 55, count)
    vertices = joints[near] + random.normal(0, 0.05, (count, 3))
    weights = np.zeros((count, 55))
    for row, joint in zip(weights, near):
        others = random.choice(55, random.integers(0, 8), replace=False)
        row[others] = random.uniform(0.05, 1, len(others))
        row[joint] = 1
    regressor = random.uniform(0, 1, (55, count)) ** 40  # a few vertices count for each joint
    # shape | expression, with different sizes so that mixing them up shows
    shape = np.concatenate([random.normal(0, 0.01, (count, 3, 10)), random.normal(0, 0.004, (count, 3, 10))], -1)
    kintree = np.array([PARENTS, range(55)], np.int64).astype(np.uint32)  # -1 becomes 2^32-1
    compact = lambda a: a.astype(np.float32).astype(np.float64)
    return {
        "v_template": compact(vertices),
        "f": random.integers(0, count, (count * 2, 3)).astype(np.uint32),
        "weights": compact(weights / weights.sum(1, keepdims=True)),
        "J_regressor": compact(regressor / regressor.sum(1, keepdims=True)),
        "kintree_table": kintree,
        "shapedirs": np.round(shape * 2 ** 16) / 2 ** 16,
        "posedirs": (np.round(random.normal(0, 0.002, (count, 3, 486)) * 2 ** 13) / 2 ** 13).astype(np.float16),
        "hands_meanl": compact(random.normal(0, 0.3, 45)),
        "hands_meanr": compact(random.normal(0, 0.3, 45)),
        "hands_componentsl": np.eye(45),
        "hands_componentsr": np.eye(45)}


def random_inputs(random):
    """Poses as smplx's parameters; float32 numbers, so that both sides start from the same."""
    poses = random.normal(0, 0.4, (POSES, 55, 3))
    poses[:, 0] = random.normal(0, 1.5, (POSES, 3))  # the root turns all the way round
    poses[-1] = 0
    poses[1, 5] = [np.pi, 0, 0]  # half a turn
    poses[2, 7] = [1e-6, -2e-6, 1e-7]  # almost nothing
    return {"poses": poses.reshape(POSES, 165).astype(np.float32),
            "transl": random.normal(0, 1, (POSES, 3)).astype(np.float32),
            "betas": random.normal(0, 1, (POSES, 10)).astype(np.float32),
            "expression": random.normal(0, 1, (POSES, 10)).astype(np.float32)}


def add_unused_keys(path, body):
    """smplx insists on keys for landmarks and on float arrays; they do not change vertices or the 55 joints."""
    full = {key: value.astype(np.float64) if key == "posedirs" else value for key, value in body.items()}
    full.update(lmk_faces_idx=np.zeros(51, np.int64), lmk_bary_coords=np.full((51, 3), 1 / 3),
                dynamic_lmk_faces_idx=np.zeros((79, 17), np.int64), dynamic_lmk_bary_coords=np.full((79, 17, 3), 1 / 3))
    np.savez(path, **full)


def evaluate(body, inputs, flat_hand_mean):
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "SMPLX_NEUTRAL.npz"
        add_unused_keys(path, body)
        # smplx picks extra joints by vertex number up to 9,929, which a small body has not; they are not compared.
        picks = smplx.body_models.VERTEX_IDS["smplx"]
        picks.update(dict.fromkeys(picks, 0))
        model = smplx.SMPLX(str(path), use_pca=False, flat_hand_mean=flat_hand_mean, num_betas=10,
                            num_expression_coeffs=10, batch_size=POSES, dtype=torch.float64, ext="npz")
    tensor = lambda a: torch.from_numpy(a.astype(np.float64))
    pose = tensor(inputs["poses"])
    out = model(global_orient=pose[:, :3], body_pose=pose[:, 3:66], jaw_pose=pose[:, 66:69], leye_pose=pose[:, 69:72],
                reye_pose=pose[:, 72:75], left_hand_pose=pose[:, 75:120], right_hand_pose=pose[:, 120:165],
                betas=tensor(inputs["betas"]), expression=tensor(inputs["expression"]), transl=tensor(inputs["transl"]))
    return out.vertices.detach().numpy(), out.joints.detach().numpy()[:, :55]


def main():
    random = np.random.default_rng(20240611)
    body = generated_body(random, 400)
    inputs = random_inputs(random)
    answers = dict(inputs)
    for key, flat in (("flat", True), ("mean", False)):
        vertices, joints = evaluate(body, inputs, flat)
        answers[f"generated_{key}_vertices"] = vertices[:, ::2].astype(np.float32)
        answers[f"generated_{key}_joints"] = joints.astype(np.float32)
    open_body = dict(np.load(OPEN_BODY))
    vertices, joints = evaluate(open_body, inputs, True)
    chosen = np.sort(random.choice(len(open_body["v_template"]), OPEN_VERTICES, replace=False))
    answers["open_indices"] = chosen.astype(np.int64)
    answers["open_vertices"] = vertices[:, chosen].astype(np.float32)
    answers["open_joints"] = joints.astype(np.float32)

    FIXTURES.mkdir(exist_ok=True)
    np.savez_compressed(FIXTURES / "generated_smplx.npz", **body)
    np.savez_compressed(FIXTURES / "smplx_answers.npz", **answers)
    SEEDS.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(SEEDS / "four_vertices.npz", **generated_body(random, 4))
    for path in (FIXTURES / "generated_smplx.npz", FIXTURES / "smplx_answers.npz", SEEDS / "four_vertices.npz"):
        print(path.name, path.stat().st_size, "bytes")


if __name__ == "__main__":
    main()
