"""Every launch file compiles and, where ROS 2's launch is installed, describes a launch."""

import importlib.util
import pathlib
import sys

for path in sorted(pathlib.Path(sys.argv[1]).glob("*.launch.py")):
    source = path.read_text()
    compile(source, str(path), "exec")
    if importlib.util.find_spec("launch_ros") is None:
        print(f"{path.name}: syntax only, launch_ros is not installed")
        continue
    scope = {}
    exec(source, scope)
    entities = scope["generate_launch_description"]().entities
    assert entities, f"{path.name} describes nothing"
    print(f"{path.name}: {len(entities)} entities")
