import pathlib
import warnings
import xml.etree.ElementTree as ElementTree

from setuptools import setup

# colcon runs `setup.py install`, and reports the advice against it as if something were wrong.
warnings.filterwarnings("ignore", r"(?s).*(setup\.py install|easy_install command) is deprecated")

# Name, version and description stand in package.xml alone.
manifest = ElementTree.parse(pathlib.Path(__file__).with_name("package.xml")).getroot()
name = manifest.findtext("name")

setup(
    name=name,
    version=manifest.findtext("version"),
    description=" ".join(manifest.findtext("description").split()),
    license=" OR ".join(license.text for license in manifest.iter("license")),
    maintainer=manifest.findtext("maintainer"),
    maintainer_email=manifest.find("maintainer").get("email"),
    packages=[name],
    python_requires=">=3.10",
    install_requires=["numpy"],
    extras_require={"test": ["pytest"]},
    zip_safe=True,
    entry_points={
        "ros2cli.command": ["wrapyfi = wrapyfi_py.command:WrapyfiCommand"],
        "ros2doctor.checks": ["WrapyfiRoutesCheck = wrapyfi_py.doctor:RoutesCheck"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{name}"]),
        (f"share/{name}", ["package.xml"]),
    ],
)
