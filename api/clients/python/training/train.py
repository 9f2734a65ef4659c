#!/usr/bin/env python3
"""Trains a small network to find craters and rocks in frames of `selenograph batch`, and says how well it does on
frames that it has not seen: intersection over union of its masks with the labels, beside that of marking every pixel.

usage: train.py DIR [--epochs 12] [--crop 128] [--seed 0] [--plot FILE.png]
"""

import argparse
import time
from typing import Tuple

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from frames import LabelledFrames

KINDS = ("craters", "rocks")


class Network(nn.Module):
    """A U-Net (Ronneberger et al. 2015) of three levels, for images whose sides are multiples of 4."""

    def __init__(self, width: int = 12) -> None:
        super().__init__()

        def block(channels: int, out: int) -> nn.Sequential:
            return nn.Sequential(nn.Conv2d(channels, out, 3, padding=1), nn.BatchNorm2d(out), nn.ReLU(),
                                 nn.Conv2d(out, out, 3, padding=1), nn.BatchNorm2d(out), nn.ReLU())

        self.fine, self.middle, self.coarse = block(1, width), block(width, 2 * width), block(2 * width, 4 * width)
        self.up_middle, self.up_fine = block(6 * width, 2 * width), block(3 * width, width)
        self.last = nn.Conv2d(width, len(KINDS), 1)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        # Whatever the exposure.
        mean, deviation = image.mean((1, 2, 3), keepdim=True), image.std((1, 2, 3), keepdim=True)
        fine = self.fine((image - mean) / (deviation + 1e-3))
        middle = self.middle(functional.max_pool2d(fine, 2))
        coarse = self.coarse(functional.max_pool2d(middle, 2))
        up = self.up_middle(torch.cat([functional.interpolate(coarse, scale_factor=2), middle], 1))
        return self.last(self.up_fine(torch.cat([functional.interpolate(up, scale_factor=2), fine], 1)))


def crops(item: dict, side: int, random: np.random.Generator) -> Tuple[torch.Tensor, torch.Tensor]:
    """A square of a frame and its masks, turned and mirrored at random."""
    height, width = item["image"].shape[1:]
    y, x = random.integers(height - side + 1), random.integers(width - side + 1)
    both = torch.cat([item["image"], item["masks"]])[:, y:y + side, x:x + side]
    both = torch.rot90(both, int(random.integers(4)), (1, 2))
    if random.integers(2):
        both = both.flip(2)
    return both[:1], both[1:]


def train(network: Network, frames: list, epochs: int, side: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    batch = 8
    steps = -(-len(frames) // batch)
    marked = torch.stack([item["masks"].mean((1, 2)) for item in frames]).mean(0)
    # What is rare counts as much as the rest, within limits.
    weights = ((1 - marked) / marked.clamp_min(1e-6)).clamp(1, 20).sqrt()[:, None, None]
    optimizer = torch.optim.Adam(network.parameters(), lr=3e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 3e-3, total_steps=epochs * steps)
    for epoch in range(epochs):
        network.train()
        total = 0.0
        order = random.permutation(len(frames))
        for step in range(steps):
            chosen = [frames[i] for i in order[step * batch:(step + 1) * batch]]
            images, masks = (torch.stack(part) for part in zip(*(crops(item, side, random) for item in chosen)))
            loss = functional.binary_cross_entropy_with_logits(network(images), masks, pos_weight=weights)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            total += float(loss.detach())
        print(f"epoch {epoch + 1}: loss {total / steps:.4f}", flush=True)


@torch.no_grad()
def overlap(network: Network, frames: list) -> Tuple[np.ndarray, np.ndarray]:
    """Intersection over union by kind, of the network's masks and of every pixel marked."""
    network.eval()
    both, either, marked, pixels = np.zeros(2), np.zeros(2), np.zeros(2), 0
    for item in frames:
        found = network(item["image"][None])[0] > 0
        truth = item["masks"] > 0
        both += (found & truth).sum((1, 2)).numpy()
        either += (found | truth).sum((1, 2)).numpy()
        marked += truth.sum((1, 2)).numpy()
        pixels += truth[0].numel()
    return both / np.maximum(either, 1), marked / pixels


@torch.no_grad()
def plot(network: Network, frames: list, path: str) -> None:
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    network.eval()
    figure, axes = plt.subplots(3, len(frames), figsize=(3 * len(frames), 9), squeeze=False)
    for column, item in zip(axes.T, frames):
        image = item["image"][0].numpy()
        found = (network(item["image"][None])[0] > 0).numpy()
        for axis, title, masks in zip(column, ("image", "labels", "found"), (None, item["masks"].numpy() > 0, found)):
            shown = np.repeat(image[:, :, None], 3, axis=2)
            if masks is not None:
                shown[masks[0], 0] = 0.6 * shown[masks[0], 0] + 0.4
                shown[masks[1], 2] = 1
            axis.imshow(shown)
            axis.set_title(title)
            axis.axis("off")
    figure.tight_layout()
    figure.savefig(path, dpi=80)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("folder")
    parser.add_argument("--epochs", type=int, default=12)
    parser.add_argument("--crop", type=int, default=128, help="pixels of a training example's side, a multiple of 4")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--plot", metavar="FILE.png", help="three unseen frames with labels and what was found")
    args = parser.parse_args()
    torch.manual_seed(args.seed)
    dataset = LabelledFrames(args.folder)
    unseen = max(1, len(dataset) // 5)
    frames = [dataset[i] for i in range(len(dataset))]
    network = Network()
    started = time.monotonic()
    train(network, frames[unseen:], args.epochs, args.crop, args.seed)
    print(f"{len(frames) - unseen} frames, {args.epochs} epochs, {time.monotonic() - started:.0f} s")
    by_network, by_all = overlap(network, frames[:unseen])
    for kind, reached, chance in zip(KINDS, by_network, by_all):
        print(f"{kind}: intersection over union {reached:.3f}; every pixel marked: {chance:.3f}")
    if args.plot:
        plot(network, frames[:3], args.plot)


if __name__ == "__main__":
    main()
