#!/usr/bin/env python3
"""Makes the stored answers that the tests of the metrics compare with: scikit-image, NVIDIA's flip-evaluator and numpy.

    python3 -m venv venv && venv/bin/pip install numpy scikit-image flip-evaluator
    venv/bin/python tests/unit/metrics/metrics_compare.py

Writes tests/unit/metrics/fixtures/metrics_answers.npz: two pictures `a` and `b` of 45x61 pixels (float32, RGB in
[0, 1]) with flat areas, edges, gradients and noise, a mask, two pictures of normals, and the answers in float64.
flip-evaluator works in float32, so its numbers carry an error of their own (1e-5).
"""
import pathlib

import flip_evaluator
import numpy as np
from skimage.metrics import structural_similarity

OUT = pathlib.Path(__file__).resolve().parent / "fixtures" / "metrics_answers.npz"
HEIGHT, WIDTH = 45, 61


def pictures(random):
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    a = np.stack([x / WIDTH, y / HEIGHT, 0.5 + 0.5 * np.sin(x / 3.0) * np.cos(y / 5.0)], -1)
    a[8:20, 10:30] = [0.9, 0.1, 0.05]
    a[25:40, 35:50] = [0.0, 0.0, 1.0]
    a[30:35, 5:25:2] = [1.0, 1.0, 1.0]
    b = 0.9 * np.roll(a, (1, 2), (0, 1)) + 0.05 + random.normal(0, 0.04, a.shape)
    b[25:40, 35:50] = [0.0, 0.8, 0.1]  # far in colour alone
    return np.clip(a, 0, 1).astype(np.float32), np.clip(b, 0, 1).astype(np.float32)


def angles_deg(u, v):
    u = u / np.linalg.norm(u, axis=-1, keepdims=True)
    v = v / np.linalg.norm(v, axis=-1, keepdims=True)
    return np.degrees(2 * np.arctan2(np.linalg.norm(u - v, axis=-1), np.linalg.norm(u + v, axis=-1)))


def main():
    random = np.random.default_rng(20250214)
    a32, b32 = pictures(random)
    a, b = a32.astype(np.float64), b32.astype(np.float64)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    mask = ((x - 30) ** 2 / 25 ** 2 + (y - 20) ** 2 / 19 ** 2 < 1)
    other = ((x - 33) ** 2 / 22 ** 2 + (y - 23) ** 2 / 20 ** 2 < 1)
    normals_a = random.normal(0, 1, (HEIGHT, WIDTH, 3)).astype(np.float32)
    normals_b = (normals_a + random.normal(0, 0.4, normals_a.shape)).astype(np.float32)
    angles = angles_deg(normals_a.astype(np.float64), normals_b.astype(np.float64))

    mean_ssim, ssim = structural_similarity(a, b, channel_axis=-1, gaussian_weights=True, sigma=1.5,
                                            use_sample_covariance=False, data_range=1.0, full=True)
    inner = np.zeros_like(mask)
    inner[5:-5, 5:-5] = True
    answers = {
        "a": a32, "b": b32, "mask": mask.astype(np.float32), "other_mask": other.astype(np.float32),
        "normals_a": normals_a, "normals_b": normals_b,
        "mae": np.abs(a - b).mean(), "mae_masked": np.abs(a - b)[mask].mean(),
        "rmse": np.sqrt(((a - b) ** 2).mean()), "rmse_masked": np.sqrt(((a - b)[mask] ** 2).mean()),
        "psnr": 10 * np.log10(1 / ((a - b) ** 2).mean()), "psnr_masked": 10 * np.log10(1 / ((a - b)[mask] ** 2).mean()),
        "correlation": np.corrcoef(a.ravel(), b.ravel())[0, 1],
        "correlation_masked": np.corrcoef(a[mask].ravel(), b[mask].ravel())[0, 1],
        "median_red": np.median(np.abs(a - b)[..., 0]), "median_red_masked": np.median(np.abs(a - b)[mask][:, 0]),
        "ssim": mean_ssim, "ssim_map": ssim.astype(np.float32), "ssim_masked": ssim[mask & inner].mean(),
        "ssim_grey": structural_similarity(a[..., 1], b[..., 1], gaussian_weights=True, sigma=1.5,
                                           use_sample_covariance=False, data_range=1.0),
        "iou": (mask & other).sum() / (mask | other).sum(),
        "angle_mean": angles.mean(), "angle_median": np.median(angles), "angle_mean_masked": angles[mask].mean(),
    }
    for name, ppd in (("", None), ("_40", 40.0)):
        parameters = {} if ppd is None else {"ppd": ppd}
        flip, _, used = flip_evaluator.evaluate(a32, b32, "LDR", inputsRGB=True, applyMagma=False,
                                                parameters=parameters)
        print("FLIP at", used["ppd"], "pixels per degree")
        flip = np.asarray(flip, np.float64).reshape(HEIGHT, WIDTH)
        answers[f"flip{name}"] = flip.mean()
        answers[f"flip_map{name}"] = flip.astype(np.float32)
        answers[f"flip_masked{name}"] = flip[mask].mean()
    OUT.parent.mkdir(exist_ok=True)
    np.savez_compressed(OUT, **answers)
    for key, value in answers.items():
        if np.ndim(value) == 0:
            print(f"{key:20} {value:.9f}")
    print(OUT.name, OUT.stat().st_size, "bytes")


if __name__ == "__main__":
    main()
