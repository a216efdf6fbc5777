"""A tiny dataset whose camera has channels."""

from pathlib import Path

from stage_text import edited, stage_in, tiny_text, without_method

TRIANGLE = {"red": (580, 620, 680), "green": (500, 540, 590), "blue": (430, 460, 510)}
"""First, brightest and last wavelength of each channel [nm]."""


def channel(name: str, wavelengths: tuple[int, int, int]) -> str:
    return f"""
            def PlenChannel "{name}"
            {{
                uniform int plen:nodes = 2
                uniform double[] plen:response = [0, 1, 0]
                uniform double[] plen:wavelengths = {list(wavelengths)}
            }}
"""


def stage_at(folder: Path, tiny: str, channels: dict[str, tuple[int, int, int]]) -> Path:
    """A tiny dataset of the tests whose camera has channels, in a folder of its own."""
    text = without_method(tiny_text(tiny)).replace("plen:image:samples = 64", "plen:image:samples = 16")
    sensor, lens = '        over "Sensor"\n        {\n', '        over "Lens"\n        {\n'
    if lens not in text:
        text = text.replace(sensor, f"{lens}        }}\n\n{sensor}")
    text = text.replace(lens, f'{lens}            uniform token plen:indexSource = "catalogue"\n')
    written = "".join(channel(name, wavelengths) for name, wavelengths in channels.items())
    return stage_in(folder, edited(text, (sensor, sensor + written)))
