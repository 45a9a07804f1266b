"""Tables with a mapping."""

import csv

import yaml


def write_csv(path, columns, delimiter=","):
    with path.open("w", newline="") as file:
        writer = csv.writer(file, delimiter=delimiter, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))


def write_mapping(folder, *, name="columns.yaml", time=None, shared=None, **joint_states):
    topic = {"file": "run.csv", "joints": ["a"], "position": {"column": "q"}, **joint_states}
    content = {"time": time or {"column": "t"}, "topics": {"joint_states": topic}, **(shared or {})}
    (folder / name).write_text(yaml.safe_dump(content))
    return folder / name
