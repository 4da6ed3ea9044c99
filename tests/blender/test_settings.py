"""The panel's settings are the core's."""

import dataclasses

import bpy
import pytest
from blender.checkout import load

settings_group = load("bsface_addon.settings_group")
core_settings = load("core.settings")
Settings = core_settings.Settings


def group():
    return bpy.context.scene.bsface.settings


def test_defaults_are_the_cores(addon):
    assert settings_group.to_core(group()) == Settings()


def test_every_setting_has_a_property_with_a_tooltip(addon):
    shown = set(settings_group.NAMES) - set(settings_group.POINTS)
    fields = {field.name for field in dataclasses.fields(Settings)}
    assert shown == fields - {"control_points"}
    for name in settings_group.NAMES:
        assert group().bl_rna.properties[name].description, name
    assert set(settings_group.MAIN) <= set(settings_group.NAMES)


@pytest.mark.parametrize("name", core_settings.LIMITS)
def test_limits_are_the_cores(addon, name):
    low, high = core_settings.LIMITS[name]
    for value in (low, high):
        setattr(group(), name, type(getattr(group(), name))(value))
        made = getattr(settings_group.to_core(group()), name)
        assert made == pytest.approx(value)
    setattr(group(), name, type(getattr(group(), name))(high * 2))
    settings_group.to_core(group())


def test_choices_are_the_cores(addon):
    for name in settings_group.CHOICES:
        for item in group().bl_rna.properties[name].enum_items:
            setattr(group(), name, item.identifier)
            settings_group.to_core(group())


def test_net_size(addon):
    group().control_points_u, group().control_points_v = 12, 20
    assert settings_group.to_core(group()).control_points == (12, 20)
    changed = settings_group.to_core(group(), {"control_points": (9, 8)})
    assert changed.control_points == (9, 8)


def test_folder_of_model_files_reaches_the_core(tmp_path, monkeypatch):
    from types import SimpleNamespace

    preferences = load("bsface_addon.preferences")
    face_models = load("core.landmarks.face_models")
    monkeypatch.setenv(preferences.VARIABLE, "")
    preferences.tell_core(SimpleNamespace(models=str(tmp_path)))
    assert tmp_path in face_models.model_folders()
    preferences.tell_core(SimpleNamespace(models=""))
    assert tmp_path not in face_models.model_folders()
