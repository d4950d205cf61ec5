"""A lens as a function of PyTorch, with gradients: `lenscube.torch.apply(lens, x, pitch_um=2)`.

PyTorch is not a requirement of the package; this module alone imports it. The lens computes on the CPU: tensors of other devices are copied there and the result back.
"""

# mypy: ignore-errors
# PyTorch is not there when the package is checked.

from typing import Any

import torch

from ._lens import Lens


class _Film(torch.autograd.Function):
    """The film of a chart; a film is linear in it, so the gradient is the transpose applied to that of the film."""

    @staticmethod
    def forward(ctx: Any, x: torch.Tensor, lens: Lens, place: dict[str, Any]) -> torch.Tensor:
        ctx.lens, ctx.place = lens, {**place, "chart_size": tuple(x.shape[-2:])}
        film = lens.apply(x.detach().to("cpu", torch.float32).numpy(), **place)
        return torch.from_numpy(film).to(x.device, x.dtype)

    @staticmethod
    def backward(ctx: Any, *grad: torch.Tensor) -> tuple[torch.Tensor, None, None]:
        (of_film,) = grad
        of_chart = ctx.lens.adjoint(of_film.detach().to("cpu", torch.float32).contiguous().numpy(), **ctx.place)
        return torch.from_numpy(of_chart).to(of_film.device, of_film.dtype), None, None


def apply(lens: Lens, x: torch.Tensor, **place: Any) -> torch.Tensor:
    """The film of a tensor (band, y, x), or (n, band, y, x), as `Lens.apply` makes it with the arguments `place`; gradients flow back to `x`."""
    film: torch.Tensor = _Film.apply(x, lens, place)
    return film
