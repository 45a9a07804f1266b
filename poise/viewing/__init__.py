"""Draws results for people. No node needs it; import the module you want, drawing libraries load slowly.

- `report`: `write_identification_report`, one HTML file that stands alone.
- `rerun_scene`: `write_identification_recording`, the same story for the Rerun viewer (needs rerun-sdk, an extra).
- `figures`: the pictures of both, for matplotlib; `canvas`, `sphere` and `decimation` are what they are drawn with,
  `inline_svg` puts them into a page.
- `summary`, `wording`: a result as numbers and sentences; how numbers and external names are written.
- `files`: `write_whole`, a file or nothing.
"""
