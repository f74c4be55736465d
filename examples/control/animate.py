"""The arm that picks up a load, as a short animation.

``python examples/control/animate.py`` follows one of the paper's paths twice: by the
model of the nearest known load, and by the load that it tracks. It draws the arm, as it
should be and as it is, beside the errors, into examples/output/control.gif. Run run.py
first: its folder has the learned models, which are used if they are there.
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("agg")

import matplotlib.pyplot as plt
import numpy as np
import pinocchio as pin
from matplotlib.animation import FuncAnimation, PillowWriter
from plant import CONTROL, Reference
from run import LOOKS, OUTPUT, SECOND, controllers, follow, learned

from skmtgp.datasets import load_puma560
from skmtgp.datasets._robot import _pinocchio_model

SHOWN = {
    "mGP, the nearest known load": "the nearest known load",
    "mGP, tracked load": "the load that it tracks",
}
FRAMES = 15  # a second


class Skeleton:
    """Where the joints are, in m."""

    def __init__(self):
        self.model = _pinocchio_model(pin, None)
        self.data = self.model.createData()

    def __call__(self, q):
        """Positions of the joints and the hand, of shape (7, 3)."""
        pin.forwardKinematics(self.model, self.data, np.asarray(q, dtype=float))
        joints = [np.array(place.translation) for place in self.data.oMi[1:]]
        last = self.data.oMi[self.model.njoints - 1]
        hand = last.translation + last.rotation @ [0.0, 0.0, 0.15]
        return np.array([*joints, hand])


def main():
    """Follow the path, and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--models", type=Path, default=OUTPUT / "control")
    parser.add_argument("--output", type=Path, default=OUTPUT / "control.gif")
    parser.add_argument("--path", type=int, default=4)
    args = parser.parse_args()
    puma = load_puma560(n_per_load=20, descriptors="inertial")
    loads = puma.loads.iloc[:, -10:].to_numpy(float)
    compared = controllers(
        learned(loads[:SECOND], args.models), loads, puma.target.std(axis=0)
    )
    reference = Reference(args.path, 4)
    picked_up = int(0.3 * len(reference.q))
    errors = {
        name: follow(reference, compared[key](), loads, picked_up)[0]
        for key, name in SHOWN.items()
    }
    draw(reference, errors, picked_up, args.output)


def draw(reference, errors, picked_up, path):
    """Write the animation."""
    figure = plt.figure(figsize=(8, 3.6), layout="constrained")
    arm = figure.add_subplot(1, 2, 1, projection="3d")
    curve = figure.add_subplot(1, 2, 2)
    skeleton, update = Skeleton(), []
    colors = {name: LOOKS[key] for key, name in SHOWN.items()}
    seconds = np.arange(len(reference.q)) / CONTROL
    wanted = np.roll(reference.q, -1, axis=0)
    for name, color in {"the path": "0.6", **colors}.items():
        off = errors.get(name, np.zeros_like(wanted))
        moved = wanted - 3.0 * off  # errors are drawn three times as large
        style = {"color": color, "lw": 5 if name == "the path" else 2}
        (line,) = arm.plot(*skeleton(moved[0]).T, "-o", ms=3, label=name, **style)
        update.append(lambda k, line=line, q=moved: line.set_data_3d(*skeleton(q[k]).T))
        if name in errors:
            size = 1e3 * np.linalg.norm(off, axis=1)
            (drawn,) = curve.semilogy([], [], color=color, label=name)
            update.append(
                lambda k, drawn=drawn, size=size: drawn.set_data(
                    seconds[: k + 1], size[: k + 1]
                )
            )
    curve.axvline(picked_up / CONTROL, color="0.5", ls="--", lw=0.8)
    curve.text(picked_up / CONTROL, 70, " 3 kg", va="top")
    curve.set(xlim=(0, seconds[-1]), ylim=(3e-3, 100), xlabel="seconds")
    curve.set_title("error of the joints, mrad")
    places = np.concatenate([skeleton(q) for q in wanted[::50]])
    low, high = places.min(axis=0) - 0.1, places.max(axis=0) + 0.1
    arm.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    arm.set_box_aspect(high - low, zoom=1.3)
    arm.set_title("the arm, errors three times as large")
    arm.set_axis_off()
    figure.legend(*arm.get_legend_handles_labels(), loc="outside lower center", ncols=3)

    def frame(k):
        for change in update:
            change(k)

    steps = range(0, len(seconds), CONTROL // FRAMES)
    path.parent.mkdir(parents=True, exist_ok=True)
    movie = FuncAnimation(figure, frame, frames=steps)
    movie.save(path, writer=PillowWriter(fps=FRAMES), dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    main()
