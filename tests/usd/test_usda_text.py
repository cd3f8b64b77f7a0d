"""Editing the text of USD files: places are found where USD finds them, and only one number changes."""

import pytest
from pxr import Sdf

from mrwarp.usd.edit import UsdaTextError, set_values


def set_value(text: str, path: str, name: str, value: float | str, type_name: str) -> str:
    """One attribute."""
    return set_values(text, path, {name: (value, type_name)})


TRICKY = '''#usda 1.0
(
    doc = """A brace } and a quote " in a doc: def "no" { }"""
)

# def "comment" { double a = 1 }
def Xform "top" (
    customData = {
        string text = "} def \\"x\\" {"
    }
    variants = {
        string size = "big"
    }
    prepend variantSets = "size"
)
{
    custom double a = 1 (
        doc = "a = 2 {"
    )
    double[] list = [1, 2,
        3]
    double b.timeSamples = {
        0: 1,
        1: 2,
    }
    rel target = </top/inner>
    asset file = @some{file}.txt@
    double declared
    uniform token[] order = ["a", "}"] # a comment with }
    def "empty" {}
    reorder nameChildren = ["inner", "empty"]

    variantSet "size" = {
        "big" (
            doc = "x"
        ) {
            over "inner"
            {
                double c = -1e-3; double d = 4 /* } */
            }
            variantSet "colour" = {
                'red' {
                    def "deep"
                    {
                        float e = inf
                    }
                }
            }
        }
    }
}
'''


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("/top", "a"),
        ("/top", "declared"),
        ("/top", "new"),
        ("/top/empty", "new"),
        ("/top{size=big}inner", "c"),
        ("/top{size=big}inner", "d"),
        ("/top{size=big}inner", "new"),
        ("/top{size=big}{colour=red}deep", "e"),
        ("/top{size=big}{colour=red}deep", "new"),
    ],
)
def test_set_value_in_tricky_text(path, name, newline):
    """USD reads the new number where it was meant, and everything else as before; line ends stay."""
    text = TRICKY.replace("\n", newline)
    edited = set_value(text, path, name, 0.25, "double")
    before, after = Sdf.Layer.CreateAnonymous(".usda"), Sdf.Layer.CreateAnonymous(".usda")
    before.ImportFromString(text)
    after.ImportFromString(edited)
    assert after.GetAttributeAtPath(f"{path}.{name}").default == 0.25
    assert str(after.GetAttributeAtPath(f"{path}.{name}").typeName) == "double"
    assert edited.count("\n") - edited.count("\r\n") == (0 if newline == "\r\n" else edited.count("\n"))
    prim = before.GetPrimAtPath(path)
    attribute = prim.attributes.get(name) or Sdf.AttributeSpec(prim, name, Sdf.ValueTypeNames.Double)
    attribute.SetInfo("typeName", "double")
    attribute.default = 0.25
    assert after.ExportToString() == before.ExportToString()


def test_set_value_changes_the_type_too():
    """A number stored in 32 bits becomes a double, in the same line."""
    text = '#usda 1.0\ndef "a"\n{\n    float x = 1  # unit\n}\n'
    assert set_value(text, "/a", "x", 0.1, "double") == text.replace("float x = 1", "double x = 0.1")
    array = text.replace("float x = 1", "uniform float[] x = [1, 2]")
    assert set_value(array, "/a", "x", 0.1, "double") == text.replace("float x = 1", "uniform double x = 0.1")


@pytest.mark.parametrize("value", ["", "it's", '{"a": "b\\\\n"}', "\\", "'\\''", "} # {"])
def test_quoted_text_reads_back(value):
    """USD reads a quoted text as it was, new or in place of another; the scanner reads on behind it."""
    text = '#usda 1.0\ndef "a"\n{\n    double x = 1\n}\n'
    for old in ("none", "another"):
        text = set_value(text, "/a", "note", old, "string")
    text = set_value(text, "/a", "note", value, "string")
    text = set_value(text, "/a", "x", 2.0, "double")
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(text)
    assert layer.GetAttributeAtPath("/a.note").default == value
    assert layer.GetAttributeAtPath("/a.x").default == 2.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('#usda 1.0\ndef "a"\n{\n}\n', "/b does not stand in the text"),
        ('#usda 1.0\ndef "b"\n{\n', "not readable"),
        ("#usda 1.0\nsomething else\n", "not readable"),
    ],
)
def test_set_value_refuses(text, words):
    """A prim that is not there and a text that is not understood are refused with the place."""
    with pytest.raises(UsdaTextError, match=words):
        set_value(text, "/b", "x", 1.0, "double")
