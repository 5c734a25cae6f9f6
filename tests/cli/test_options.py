import argparse
from dataclasses import fields

import pytest

from tpdwarp.cli.options import EXPOSURE, MACHINE, METHOD, PICTURE, declare_settings, settings_given, size
from tpdwarp.cli.parser import build_parser
from tpdwarp.errors import InputError
from tpdwarp.settings import CHOICES, Settings

ALL = (*PICTURE, *EXPOSURE, *METHOD, *MACHINE)


def given(*arguments):
    parser = argparse.ArgumentParser()
    declare_settings(parser, ALL)
    return settings_given(parser.parse_args(arguments))


def help_of(command, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    with pytest.raises(SystemExit):
        build_parser(("render", "photons", "info")).parse_args([command, "--help"])
    return capsys.readouterr().out


def test_every_setting_has_one_option():
    assert sorted(option.field for option in ALL) == sorted(field.name for field in fields(Settings))


def test_only_what_is_given_is_changed():
    assert given() == {}
    assert given("--photons", "5") == {"photons": 5}


@pytest.mark.parametrize(
    ("arguments", "settings"),
    [
        (["-cam", "Main"], {"camera": "Main"}),
        (["--camera", "/World/Main"], {"camera": "/World/Main"}),
        (["-w", "320"], {"image_width": 320}),
        (["--imageWidth", "320"], {"image_width": 320}),
        (["-rs", "/Render/A"], {"render_settings": "/Render/A"}),
        (["--renderSettingsPrimPath", "/Render/A"], {"render_settings": "/Render/A"}),
        (["--purposes", "render,proxy"], {"purposes": ("render", "proxy")}),
        (["--mask", "/A, /B"], {"mask": ("/A", "/B")}),
        (["--complexity", "high"], {"complexity": 1.2}),
        (["--complexity", "1.1"], {"complexity": 1.1}),
        (["--aov", "Z,caustic"], {"aovs": ("Z", "caustic")}),
        (["--crop", "0", "0", ".5", "1"], {"crop": (0.0, 0.0, 0.5, 1.0)}),
        (["--light-groups"], {"light_groups": ("auto",)}),
        (["--light-groups", "key=Key*,rest=/World/*"], {"light_groups": ("key=Key*", "rest=/World/*")}),
        (["--light-groups", "--seed", "3"], {"light_groups": ("auto",), "seed": 3}),
        (["--exposure", "0.5"], {"exposure": 0.5}),
        (["--shutter", "-0.25", ".25"], {"shutter": (-0.25, 0.25)}),
        (["--segments", "2", "--motion", "cubic"], {"segments": 2, "motion": "cubic"}),
        (["--time-filter", "cone"], {"time_filter": "cone"}),
        (["--seed", "3", "--threads", "1", "--device", "cuda:0"], {"seed": 3, "threads": 1, "device": "cuda:0"}),
    ],
)
def test_options_become_settings(arguments, settings):
    assert given(*arguments) == settings


def test_light_groups_without_a_value_leave_the_stage_alone():
    options = build_parser(("render",)).parse_args(["render", "--light-groups", "my.usda", "out.exr"])
    assert (options.scene, options.out, options.light_groups) == ("my.usda", "out.exr", ["auto"])
    options = build_parser(("render",)).parse_args(["render", "--light-groups", "a=b", "my.usda", "out.exr"])
    assert (options.scene, options.out, options.light_groups) == ("my.usda", "out.exr", ["a=b"])


def test_options_have_the_kinds_that_settings_take():
    defaults = Settings()
    for option in ALL:
        default = getattr(defaults, option.field)
        if isinstance(default, bool | int | float):
            assert type(option.kind("1")) is type(default), option.field
        elif isinstance(default, tuple):
            assert option.kind("a,b") == ("a", "b")


def test_frames_may_be_negative():
    parser = build_parser(("render",))
    for arguments in (["-f", "-5:-1"], ["--frames", "-5:-1"], ["--frames=-5:-1"], ["-f-5:-1"]):
        assert parser.parse_args(["render", "a", "b", *arguments]).frames == "-5:-1"
    with pytest.raises(InputError, match="expected one argument"):
        parser.parse_args(["render", "a", "b", "-f", "--photons", "3"])


@pytest.mark.parametrize("spelling", ["-d", "--default-time", "--defaultTime"])
def test_the_default_time_has_usdrecords_spellings(spelling):
    assert build_parser(("render",)).parse_args(["render", "a", "b", spelling]).default_time


@pytest.mark.parametrize("command", ["render", "photons", "info"])
def test_help_fits_two_screens(command, capsys, monkeypatch):
    lines = help_of(command, capsys, monkeypatch).splitlines()
    # Screens of 48 lines.
    assert len(lines) <= 96 and max(map(len, lines)) <= 110


def test_help_shows_documentation_choices_and_defaults(capsys, monkeypatch):
    text = help_of("render", capsys, monkeypatch)
    flowing = " ".join(text.split())
    for option in ALL:
        for flag in option.flags:
            assert flag in text
        default = getattr(Settings(), option.field)
        if default not in (None, "", ()):
            shown = ",".join(default) if isinstance(default, tuple) else default
            after = flowing[flowing.rindex(f"{option.flags[-1]} ") :]
            assert f"[{shown}]" in after[: after.find(" -", 3)], option.field
    for choices in CHOICES.values():
        assert "|".join(choices) in text
    assert "``" not in text and "None" not in text


def test_every_option_says_what_it_does():
    parser = argparse.ArgumentParser()
    declare_settings(parser, ALL)
    for action in parser._actions:
        # Words before the default.
        assert len(action.help.partition("[")[0].split()) >= 2, action.option_strings


def test_sizes_are_written_as_people_do():
    texts = {"12G": 12 * 2**30, "512M": 2**29, "1.5 GiB": 1.5 * 2**30, "64kB": 2**16, "1000": 1000}
    assert {text: size(text) for text in texts} == texts


@pytest.mark.parametrize("text", ["", "0", "-1G", "12X", "G", "nan", "1e9"])
def test_what_is_no_size_is_refused(text):
    with pytest.raises(argparse.ArgumentTypeError, match="no size"):
        size(text)
