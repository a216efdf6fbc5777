"""USD in, records out. Importing this package registers the plenScene schemas: it must come before any stage opens."""

from pipeline.scene.usd.register import register

register()
