"""Keywords to flags."""

import inspect
import json

import numpy
import pytest

import lenscube
from lenscube import _signatures, errors
from lenscube._arguments import arguments
from lenscube._program import description


def flags(**keywords):
    return arguments(("run",), [], keywords)[1:-1]


def test_values_are_written_as_flags():
    assert flags(lens="a b", film_pitch_um=numpy.float32(0.5), threads=numpy.int64(3)) == ["--lens=a b", "--film-pitch-um=0.5", "--threads=3"]
    assert flags(overwrite=True, force=False, memory=None) == ["--overwrite"]
    assert flags(bands=slice(450, 650), wavelengths=slice(400, 700, 10)) == ["--bands=450:650", "--wavelengths=400:700:10"]
    # Open ends stay open: "450" alone would be one band.
    assert flags(bands=slice(450, None)) == ["--bands=450:"] and flags(bands=slice(None, 550)) == ["--bands=:550"]
    assert flags(bands=slice(None, None, 2)) == ["--bands=::2"]
    assert flags(wavelengths=numpy.arange(400, 421, 10)) == ["--wavelengths=400,410,420"]
    assert flags(film_size=(480, 640), center=(-0.5, 1)) == ["--film-size=480x640", "--center=-0.5,1"]
    assert flags(roi=(0, 1, 2, 3)) == ["--roi=0,1,2,3"]
    assert flags(roi=[(0, 1, 2, 3), (4, 5, 6, 7)]) == ["--roi=0,1,2,3", "--roi=4,5,6,7"]
    assert flags(stages=["ri", "svpsf"]) == ["--stages=ri", "--stages=svpsf"]
    assert arguments(("measure",), ["f"], {"points": [(1, 2), (3.5, 4)]}) == ["measure", "--points=1,2;3.5,4", "--", "f"]
    assert arguments(("sensor",), ["f", "r"], {"set": {"noise.prnu": 0}})[1] == "--set=noise.prnu=0"


def test_unknown_keywords_name_close_ones():
    with pytest.raises(TypeError, match=r"run\(\) has no keyword 'lense'; close: lens"):
        lenscube.run("gen:uniform", "never", lense="double-gauss-28")
    with pytest.raises(TypeError, match="close: film_pitch_um"):
        flags(pitch_um=2)
    with pytest.raises(TypeError, match=r"lenscube.flags\('run'\) explains them"):
        flags(qqqqqq=2)
    with pytest.raises(TypeError, match="no keyword 'progress'"):
        lenscube.export("film.zarr", "out.png", progress=True)


@pytest.mark.parametrize("wrong", [{"overwrite": 3}, {"lens": True}, {"lens": {1, 2}}, {"roi": [object()]}])
def test_values_of_a_wrong_type_are_type_errors(wrong):
    with pytest.raises(TypeError, match=next(iter(wrong))):
        flags(**wrong)


def test_help_of_the_program_is_the_help_of_the_keywords():
    assert "µm" in lenscube.flags("run")["film_pitch_um"]
    assert "plot" in lenscube.flags("lens", "show")
    with pytest.raises(TypeError, match="commands: .*measure"):
        lenscube.flags("meassure")


def test_signatures_name_the_keywords(tmp_path, monkeypatch):
    def run(chart, film=None, *, progress=None, **flags):
        """Text."""

    monkeypatch.setattr(_signatures, "COMMANDS", tmp_path / "commands.json")
    _signatures.describe({("run",): run})
    assert "flags" in inspect.signature(run).parameters
    (tmp_path / "commands.json").write_text(json.dumps(description()))
    _signatures.describe({("run",): run})
    names = list(inspect.signature(run).parameters)
    assert names[:3] == ["chart", "film", "progress"] and set(names[3:]) == set(lenscube.flags("run"))
    assert "interp: Interpolation between chart pixels" in run.__doc__ and "(bicubic, bilinear) [default: bicubic]" in run.__doc__


def test_each_exit_code_has_a_class():
    described = {c["code"] for c in description()["exit_codes"]} - {0}
    assert set(errors.CLASSES) == described
    assert all(code == errors.CLASSES[code].code for code in described)
    assert not issubclass(lenscube.Interrupted, Exception) and issubclass(lenscube.UsageError, ValueError)


def test_other_commands_are_called_by_name():
    assert "cmv12000-rgb" in lenscube.command("sensor", "list")
    assert lenscube.command("man").startswith(".ie")
    with pytest.raises(TypeError, match="no command 'nothing'"):
        lenscube.command("nothing")
