"""Materials of stages, as text."""


def material_text(path: str, *inputs: str, own: str = "", beside: str = "", schemas: str = "") -> str:
    """A Material whose UsdPreviewSurface has some inputs, a line each, with lines of its own and shaders beside it."""
    meta = f'(\nprepend apiSchemas = ["{schemas}"]\n)\n' if schemas else ""
    surface = "\n".join(['uniform token info:id = "UsdPreviewSurface"', *inputs, "token outputs:surface"])
    return f"""
def Material "{path.rpartition("/")[2]}" {meta}{{
{own}
token outputs:surface.connect = <{path}/Surface.outputs:surface>
def Shader "Surface" {{
{surface}
}}
{beside}
}}
"""
