"""Every launch file can be read and, where ROS 2's launch is installed, describes a launch. Those of one name, in Python, XML and
YAML, have the same arguments and start the same nodes."""

import collections
import importlib.util
import pathlib
import sys
import xml.etree.ElementTree

HAS_LAUNCH = all(importlib.util.find_spec(name) for name in ("launch_ros", "launch_xml", "launch_yaml"))


def entities(path):
    """What launch makes of a file."""
    if path.suffix == ".py":
        scope = {}
        exec(compile(path.read_text(), str(path), "exec"), scope)
        return scope["generate_launch_description"]().entities
    from launch.frontend import Parser
    entity, parser = Parser.load(str(path))
    return parser.parse_description(entity).entities


def told(all_entities):
    """Names of the arguments, and kinds of what is started."""
    arguments = {one.name for one in all_entities if hasattr(one, "default_value")}
    return arguments, [type(one).__name__ for one in all_entities if not hasattr(one, "default_value")]


alike = collections.defaultdict(dict)
for path in sorted(pathlib.Path(sys.argv[1]).glob("*.launch.*")):
    if path.suffix == ".py":
        compile(path.read_text(), str(path), "exec")
    elif path.suffix == ".xml":
        xml.etree.ElementTree.parse(path)
    if not HAS_LAUNCH:
        print(f"{path.name}: syntax only, launch_ros is not installed")
        continue
    found = entities(path)
    assert found, f"{path.name} describes nothing"
    print(f"{path.name}: {len(found)} entities")
    alike[path.name.split(".")[0]][path.name] = told(found)
for name, files in alike.items():
    first = next(iter(files.values()))
    for file, one in files.items():
        assert one == first, f"{file} is not like the others of {name}: {one} and {first}"
