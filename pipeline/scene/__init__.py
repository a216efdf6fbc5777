"""Reading of USD stages into records. Importing this package registers the plenScene schemas, so it must be imported
before any stage is opened.
"""

from pipeline.scene.usd.roots import register

register()
