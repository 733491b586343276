"""Writes fixtures/lpips.json: LPIPS of the package `lpips` (0.1.4) on backbones whose weights are drawn by a formula.

    python make_lpips_fixtures.py HEADS_FOLDER

HEADS_FOLDER holds vgg.pth and alex.pth, the linear weights of the package. Needs torch and lpips; torchvision is only
asked for the shapes of its networks, which stand here, so that it need not be installed. Weights and pictures come from
splitmix64, which the test repeats. The numbers are stored; this script is how they came to be.
"""

import json
import sys
import types
from pathlib import Path

import torch
from torch import nn

MASK = (1 << 64) - 1
VGG = [64, 64, "M", 128, 128, "M", 256, 256, 256, "M", 512, 512, 512, "M", 512, 512, 512, "M"]


def uniform(count, seed):
    """Numbers in [-1, 1): splitmix64 of seed * 2^32 + index, its upper 24 bits."""
    values = torch.empty(count)
    numbers = []
    for i in range(count):
        z = ((seed << 32) + i + 0x9E3779B97F4A7C15) & MASK
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
        z ^= z >> 31
        numbers.append((z >> 40) / float(1 << 23) - 1.0)
    values.copy_(torch.tensor(numbers))
    return values


def alexnet():
    features = nn.Sequential(nn.Conv2d(3, 64, 11, 4, 2), nn.ReLU(), nn.MaxPool2d(3, 2), nn.Conv2d(64, 192, 5, padding=2),
                             nn.ReLU(), nn.MaxPool2d(3, 2), nn.Conv2d(192, 384, 3, padding=1), nn.ReLU(),
                             nn.Conv2d(384, 256, 3, padding=1), nn.ReLU(), nn.Conv2d(256, 256, 3, padding=1), nn.ReLU(),
                             nn.MaxPool2d(3, 2))
    return types.SimpleNamespace(features=features)


def vgg16():
    layers, width = [], 3
    for entry in VGG:
        if entry == "M":
            layers.append(nn.MaxPool2d(2, 2))
            continue
        layers += [nn.Conv2d(width, entry, 3, padding=1), nn.ReLU()]
        width = entry
    return types.SimpleNamespace(features=nn.Sequential(*layers))


class Absent(types.ModuleType):
    """Stands for packages that `lpips` imports and this script does not need."""

    def __getattr__(self, name):
        return types.SimpleNamespace()


def import_lpips():
    models = types.ModuleType("torchvision.models")
    models.alexnet = lambda pretrained=False, **_: alexnet()
    models.vgg16 = lambda pretrained=False, **_: vgg16()
    vision = types.ModuleType("torchvision")
    vision.models = models
    sys.modules.update({"torchvision": vision, "torchvision.models": models})
    for name in ["scipy", "scipy.ndimage", "skimage", "skimage.transform", "skimage.metrics", "tqdm", "IPython", "cv2",
                 "matplotlib", "matplotlib.pyplot", "skimage.color", "skimage.measure"]:
        if name not in sys.modules:
            sys.modules[name] = Absent(name)
    import lpips
    return lpips


def main(heads):
    lpips = import_lpips()
    expected = {}
    # Narrow seeds: a repeated block of a million numbers is as good as all of VGG's fifteen million.
    block = uniform(1 << 16, 7)
    for net, size in (("alex", (48, 56)), ("vgg", (48, 56))):
        loss = lpips.LPIPS(net=net, pnet_rand=True, model_path=str(heads / f"{net}.pth"), verbose=False)
        loss.eval()
        convolutions = [m for m in loss.net.modules() if isinstance(m, nn.Conv2d)]
        with torch.no_grad():
            for index, conv in enumerate(convolutions):
                fan = conv.weight[0].numel()
                count = conv.weight.numel()
                places = (torch.arange(count, dtype=torch.int64) * 40503 + index * 977) % block.numel()
                conv.weight.copy_((block[places] * (6.0 / fan) ** 0.5).view_as(conv.weight))
                places = (torch.arange(conv.bias.numel(), dtype=torch.int64) + 31 * index) % block.numel()
                conv.bias.copy_(0.05 * block[places])
        height, width = size
        pictures = [0.5 + 0.5 * uniform(height * width * 3, seed).view(height, width, 3) for seed in (1, 2)]
        picture = pictures[0].clone().requires_grad_(True)
        as_input = lambda x: x.permute(2, 0, 1).unsqueeze(0) * 2 - 1
        value = loss(as_input(picture), as_input(pictures[1]))
        value.sum().backward()
        gradient = picture.grad
        expected[net] = {"height": height, "width": width, "value": value.item(),
                         "gradient_norm": gradient.norm().item(),
                         "gradient": [gradient[y, x, c].item() for y, x, c in ((0, 0, 0), (10, 20, 1), (47, 55, 2), (30, 5, 0))]}
    path = Path(__file__).parent / "fixtures" / "lpips.json"
    path.write_text(json.dumps(expected, indent=1) + "\n")
    print(path.read_text())


main(Path(sys.argv[1]))
