"""`lenscube.Lens` beside `lenscube.run`: the same bits, the same errors; points, PSFs."""

import os
import signal
import threading

import numpy
import pytest
import xarray

import lenscube

NM = [450.0, 550.0, 650.0]
PITCH = 2.0


@pytest.fixture(scope="module")
def phone():
    with lenscube.Lens("phone", wavelengths=NM, focus_m=1) as lens:
        yield lens


@pytest.fixture(scope="module")
def picture():
    return numpy.random.default_rng(7).random((3, 120, 150), numpy.float32)


def film_of_run(picture, path, **flags):
    film = lenscube.run(picture, path, lens="phone", focus_m=1, wavelengths=NM, device="cpu", **flags)
    return next(v for name, v in film.data_vars.items() if name in ("film", "roi_0")).to_numpy()


@pytest.mark.parametrize("place", [{}, {"center_mm": (1.2, -0.9)}, {"film_size": (90, 110), "scale": (0.7, 0.8), "chart_center_mm": (0.1, 0.05)}])
def test_films_have_the_bits_of_run(phone, picture, tmp_path, place):
    film = phone.apply(picture, pitch_um=PITCH, **place)
    expected = film_of_run(picture, tmp_path / "film.zarr", **phone.placement(picture.shape[1:], PITCH, **place))
    assert film.dtype == numpy.float32
    numpy.testing.assert_array_equal(film, expected)


def test_parts_stages_and_batches(phone, picture, tmp_path):
    part = phone.apply(picture, pitch_um=PITCH, roi=(20, 30, 50, 40), stages=["ri", "distortion"])
    flags = phone.placement(picture.shape[1:], PITCH)
    expected = film_of_run(picture, tmp_path / "film.zarr", roi=(20, 30, 50, 40), stages="ri,distortion", **flags)
    numpy.testing.assert_array_equal(part, expected)
    batch = numpy.stack([picture, 1 - picture])
    out = numpy.full(batch.shape, numpy.nan, numpy.float32)
    assert phone.apply(batch, pitch_um=PITCH, out=out) is out
    for one, film in zip(batch, out, strict=True):
        numpy.testing.assert_array_equal(film, phone.apply(one, pitch_um=PITCH))
    with lenscube.Lens("phone", wavelengths=[550], focus_m=1, threads=1) as grey:
        numpy.testing.assert_array_equal(grey.apply(picture[1], pitch_um=PITCH), phone.apply(picture, pitch_um=PITCH)[1])


def test_arrays_of_xarray(phone, picture):
    at = {"y": ("y", 2e-3 * numpy.arange(120), {"units": "mm"}), "x": ("x", 2e-3 * numpy.arange(150), {"units": "mm"})}
    chart = xarray.DataArray(picture, {"wavelength": NM, **at}, ("wavelength", "y", "x"))
    numpy.testing.assert_array_equal(phone.apply(chart.transpose("y", "x", "wavelength")), phone.apply(picture, pitch_um=PITCH))
    with pytest.raises(ValueError, match="the chart has the wavelengths"):
        phone.apply(chart.assign_coords(wavelength=[450, 550, 660]))
    with pytest.raises(ValueError, match="scale_factor"):
        phone.apply(chart.assign_attrs(scale_factor=0.1))


def test_errors_are_those_of_run(phone, picture):
    with pytest.raises(lenscube.UsageError, match="design"):
        lenscube.Lens("phone")
    with pytest.raises(lenscube.UsageError, match="--shard does not apply to arrays"):
        lenscube.Lens("phone", wavelengths=NM, shard=512)
    with pytest.raises(TypeError, match="film_pitch_um"):
        lenscube.Lens("phone", wavelengths=NM, film_pitch=2)
    with pytest.raises(lenscube.UsageError, match="nosuchlens"):
        lenscube.Lens("nosuchlens", wavelengths=NM)
    with pytest.raises(lenscube.UsageError, match="not inside the film"):
        phone.apply(picture, pitch_um=PITCH, roi=(100, 0, 100, 100))
    hole = picture.copy()
    hole[2, 5, 6] = numpy.nan
    with pytest.raises(lenscube.FailedError, match="NaN at band 2, row 5, column 6"):
        phone.apply(hole, pitch_um=PITCH)
    with pytest.raises(ValueError, match="3 bands"):
        phone.apply(picture[:2], pitch_um=PITCH)
    with pytest.raises(ValueError, match="out"):
        phone.apply(picture, pitch_um=PITCH, out=numpy.empty((3, 120, 150)))
    closed = lenscube.Lens("phone", wavelengths=NM)
    closed.close()
    with pytest.raises(ValueError, match="closed"):
        closed.apply(picture, pitch_um=PITCH)


def test_threads_share_a_lens(phone, picture):
    expected, found = phone.apply(picture, pitch_um=PITCH), [None] * 4

    def work(i):
        found[i] = phone.apply(picture, pitch_um=PITCH)

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for film in found:
        numpy.testing.assert_array_equal(film, expected)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_forked_processes_use_a_lens(phone, picture):
    # As workers of PyTorch's DataLoader: known films, new places and new lenses.
    expected = phone.apply(picture, pitch_um=PITCH)
    pid = os.fork()
    if pid == 0:
        signal.alarm(100)
        same = (phone.apply(picture, pitch_um=PITCH) == expected).all()
        phone.apply(picture, pitch_um=PITCH, center_mm=(0.21, -0.13))
        lenscube.Lens("phone", wavelengths=[555], focus_m=1).apply(picture[0], pitch_um=PITCH)
        os._exit(0 if same else 1)
    assert os.waitpid(pid, 0)[1] == 0


def test_signals_end_a_film(phone):
    # A process in the background may have been started with the signal ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
    try:
        with pytest.raises(KeyboardInterrupt):
            for _ in range(100):
                phone.apply(numpy.ones((4, 3, 600, 600), numpy.float32), pitch_um=PITCH)
    finally:
        signal.signal(signal.SIGINT, before)
    assert phone.apply(numpy.ones((3, 9, 9), numpy.float32), pitch_um=PITCH).shape == (3, 9, 9)


def test_points_follow_the_film(phone):
    # Dots of a chart, and their centroids on the film without blur; the chart's centre is on the axis.
    size, dots = 401, numpy.array([(60, 60), (200, 120), (340, 300), (200, 200)])
    chart = numpy.zeros((3, size, size), numpy.float32)
    y, x = numpy.mgrid[:size, :size]
    for dot in dots:
        chart += numpy.exp(-((x - dot[0]) ** 2 + (y - dot[1]) ** 2) / (2 * 2.0**2)).astype(numpy.float32)
    pitch = 6.0
    film = phone.apply(chart, pitch_um=pitch, stages=["distortion"], center_mm=(0.0, 0.0))
    middle = (size - 1) / 2
    for band, nm in enumerate(NM):
        projected = phone.project((dots - middle) * pitch * 1e-3, nm) / (pitch * 1e-3) + middle
        for at in projected:
            near = film[band] * (numpy.hypot(x - at[0], y - at[1]) < 9)
            found = numpy.array([(near * x).sum(), (near * y).sum()]) / near.sum()
            assert numpy.abs(found - at).max() < 0.02, (nm, at, found)
    points = numpy.random.default_rng(3).uniform(-1.2, 1.2, (5, 4, 2))
    numpy.testing.assert_allclose(phone.unproject(phone.project(points)), points, atol=1e-9)
    assert phone.relative_illumination([0.0, 1.0, 2.0])[0] == 1 and (numpy.diff(phone.relative_illumination([0.0, 1.0, 2.0])) < 0).all()


@pytest.mark.parametrize("place", [{}, {"stages": "svpsf"}, {"stages": ["ri", "distortion"]}, {"center_mm": (1.1, 0.7)}, {"scale": 0.8, "roi": (8, 4, 60, 50)}])
@pytest.mark.parametrize("flags", [{}, {"tails": "off"}, {"engine": "portable"}])
def test_adjoint_is_the_transpose(place, flags):
    numbers = numpy.random.default_rng(11)
    with lenscube.Lens("phone", wavelengths=[450, 650], focus_m=1, **flags) as lens:
        x = numbers.random((2, 90, 120), numpy.float32)
        film = lens.apply(x, pitch_um=PITCH, **place)
        y = numbers.standard_normal(film.shape, numpy.float32)
        back = lens.adjoint(y, pitch_um=PITCH, chart_size=(90, 120), **place)
        inner = [numpy.vdot(a.astype(float), b.astype(float)) for a, b in ((film, y), (x, back))]
        assert abs(inner[0] - inner[1]) < 1e-6 * numpy.linalg.norm(film) * numpy.linalg.norm(y)


def test_linear_operator_solves(phone):
    from scipy.sparse.linalg import lsqr

    chart = numpy.zeros((3, 60, 80), numpy.float32)
    chart[:, 20:40, 30:50] = 1
    operator = phone.linear_operator(chart.shape, pitch_um=PITCH)
    film = operator @ chart.ravel()
    numpy.testing.assert_array_equal(film.reshape(chart.shape), phone.apply(chart, pitch_um=PITCH))
    solved = lsqr(operator, film, iter_lim=30)[0]
    error = [numpy.linalg.norm(image - chart.ravel()) / numpy.linalg.norm(chart) for image in (film, solved)]
    assert error[1] < 0.3 * error[0], error


def test_torch_step_lowers_a_loss(phone):
    torch = pytest.importorskip("torch")
    import lenscube.torch

    chart = torch.rand((3, 24, 32), generator=torch.Generator().manual_seed(1))
    film = lenscube.torch.apply(phone, chart, pitch_um=PITCH)
    guess = film.clone().requires_grad_()
    losses = []
    for _ in range(5):
        loss = ((lenscube.torch.apply(phone, guess, pitch_um=PITCH) - film) ** 2).sum()
        (gradient,) = torch.autograd.grad(loss, guess)
        losses.append(float(loss))
        # Beside the difference quotient along the gradient.
        if len(losses) == 1:
            step = 1e-2 * gradient / gradient.norm()
            ahead, behind = (((lenscube.torch.apply(phone, guess + s * step, pitch_um=PITCH) - film) ** 2).sum() for s in (1, -1))
            assert abs(float(ahead - behind) / 2e-2 / float(gradient.norm()) - 1) < 1e-3
        guess = (guess - 0.3 * gradient).detach().requires_grad_()
    assert losses[-1] < 0.5 * losses[0], losses


def test_psf_is_the_film_of_a_point(phone):
    psf = phone.psf(1.0, -0.5, 550, pitch_um=1)
    assert 0.985 < psf.attrs["energy"] < 1 and psf.dims == ("y", "x")
    alone = lenscube.Lens("phone", wavelengths=[550], focus_m=1)
    numpy.testing.assert_array_equal(alone.psf(1.0, -0.5, pitch_um=1), psf)
    with pytest.raises(ValueError, match="wavelength"):
        phone.psf(0, 0, 560, pitch_um=1)


def test_mtf_is_that_of_the_lens():
    # Beside the transform of the traced pupil. Frequencies are those of a sensor of 1.4 µm pixels, up to half its Nyquist frequency.
    shown = lenscube.lens("phone", wavelengths=[550], lp_mm=[50, 100, 180])["mtf"]
    lens = lenscube.Lens("phone", wavelengths=[550])
    rows = [row for row in shown if row["image_height_mm"] < 1.8]
    assert len({row["image_height_mm"] for row in rows}) >= 2
    for row in rows:
        mtf = lens.mtf(0, -row["image_height_mm"], frequencies=[0, row["frequency_lp_mm"]])
        assert mtf.sel(frequency=0).to_numpy().tolist() == [1, 1]
        for direction in ("tangential", "sagittal"):
            found = float(mtf.sel(direction=direction)[1])
            assert abs(found - row[direction]) < 0.01, (row, direction, found)
