//! Resources that one test has to itself.

use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};
use std::hash::{Hash as _, Hasher as _};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, MutexGuard, PoisonError};

use anyhow::Context as _;
use tempfile::TempDir;

use crate::config::{Config, Route};
use crate::process::Pillars;
use crate::reserve::{self, Reserved};
use crate::{Books, Process, Result, RosNode, cpp, installation, programs, repository};

/// Keeps CycloneDDS on the loopback interface, without multicast, which `lo` often cannot do.
const LOOPBACK: &str = "<CycloneDDS><Domain Id=\"any\"><General><Interfaces><NetworkInterface name=\"lo\"/></Interfaces>\
<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>\
<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery></Domain></CycloneDDS>";

/// A DDS domain, ZeroMQ ports, topic names and a folder that no other test has.
#[derive(Debug)]
pub struct TestEnv {
    prefix: String,
    domain: Reserved,
    pub_port: Reserved,
    sub_port: Reserved,
    rep_port: Reserved,
    req_port: Reserved,
    ros_port: Reserved,
    yarp_port: Reserved,
    folder: TempDir,
    pillars: Pillars,
    variables: Mutex<BTreeMap<String, OsString>>,
}

/// The arguments of a program.
pub trait Args: IntoIterator<Item: AsRef<OsStr>> {}

impl<T: IntoIterator<Item: AsRef<OsStr>>> Args for T {}

impl TestEnv {
    /// Reserves everything for `test`.
    pub fn new(test: &str) -> Result<Self> {
        Ok(Self {
            prefix: format!("/{test}_{}", std::process::id()),
            domain: reserve::domain()?,
            pub_port: reserve::port()?,
            sub_port: reserve::port()?,
            rep_port: reserve::port()?,
            req_port: reserve::port()?,
            ros_port: reserve::port()?,
            yarp_port: reserve::port()?,
            folder: TempDir::with_prefix("wrapyfi_e2e_")
                .context("creating a folder for the test")?,
            pillars: Pillars::default(),
            variables: Mutex::default(),
        })
    }

    /// Port where ZeroMQ listeners connect.
    pub fn pub_port(&self) -> u16 {
        self.pub_port.number
    }

    /// Port where ZeroMQ publishers connect.
    pub fn sub_port(&self) -> u16 {
        self.sub_port.number
    }

    /// Port where ZeroMQ clients connect.
    pub fn rep_port(&self) -> u16 {
        self.rep_port.number
    }

    /// Port where ZeroMQ servers connect.
    pub fn req_port(&self) -> u16 {
        self.req_port.number
    }

    /// Port of the YARP name server.
    pub fn yarp_port(&self) -> u16 {
        self.yarp_port.number
    }

    /// Tells the programs of this test where the YARP name server is, as `yarp.conf` does.
    pub fn yarp_conf(&self) -> Result {
        self.write("yarp.conf", format!("127.0.0.1 {} yarp\n", self.yarp_port())).map(drop)
    }

    /// Sets a variable for the programs that are started from now on.
    pub fn set_variable(&self, name: &str, value: impl Into<OsString>) {
        self.variables().insert(name.to_owned(), value.into());
    }

    pub(crate) fn variables(&self) -> MutexGuard<'_, BTreeMap<String, OsString>> {
        self.variables.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A topic name of this test, `/…/base`.
    pub fn topic(&self, base: &str) -> String {
        format!("{}/{base}", self.prefix)
    }

    /// A path in the test's folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a file into the test's folder.
    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> Result<PathBuf> {
        let path = self.path(name);
        std::fs::write(&path, content).with_context(|| format!("writing {}", path.display()))?;
        Ok(path)
    }

    /// A folder with definitions of packages that are installed nowhere here: paths below it, such as
    /// `demo/msg/Pair.msg`, and their texts.
    pub fn definitions(&self, files: &[(&str, &str)]) -> Result<String> {
        for (name, text) in files {
            let path = format!("interfaces/{name}");
            // Written once: another process may be reading it.
            if self.path(&path).exists() {
                continue;
            }
            if let Some((folder, _)) = path.rsplit_once('/') {
                std::fs::create_dir_all(self.path(folder))?;
            }
            self.write(&path, text)?;
        }
        Ok(self.path("interfaces").display().to_string())
    }

    /// Starts `wrapyfi` with these arguments.
    pub fn wrapyfi(&self, args: impl Args) -> Result<Process> {
        self.start("wrapyfi", self.command(&programs::program()?, args))
    }

    /// Starts `wrapyfi` with a pipe for its output whose reader has gone, as `head` goes.
    pub fn wrapyfi_unread(&self, args: &[&str]) -> Result<Process> {
        self.wrapyfi_by("exec 3> >(true); wait $!; exec \"$@\" >&3", args)
    }

    /// Starts `wrapyfi` with a full pipe, whose reader stands still, for stream 1 or 2.
    pub fn wrapyfi_stalled(&self, stream: u8, args: &[&str]) -> Result<Process> {
        let full = "exec 3> >(exec sleep 600 >/dev/null 2>&1); head -c 65536 /dev/zero >&3";
        self.wrapyfi_by(&format!("{full}; exec \"$@\" {stream}>&3"), args)
    }

    /// Starts `wrapyfi` by a script of bash, whose `$@` is the command.
    pub fn wrapyfi_by(&self, script: &str, args: &[&str]) -> Result<Process> {
        let program = programs::program()?.into_os_string();
        let args = args.iter().map(Into::into);
        let all = ["-c".into(), script.into(), "bash".into(), program].into_iter().chain(args);
        let command = self.command(Path::new("bash"), all);
        self.start("wrapyfi", command)
    }

    /// Starts a YARP name server of ours on this test's port, where its programs look for one.
    pub fn yarpserver(&self) -> Result<Process> {
        self.yarp_conf()?;
        self.yarpserver_there()
    }

    /// Starts a YARP name server of ours where `yarp.conf` says.
    pub fn yarpserver_there(&self) -> Result<Process> {
        let server = self.wrapyfi(["yarpserver", "--read", "--no-discovery"])?.pillar();
        server.wait_until("the name server", |output| {
            output.err.iter().any(|line| line.contains("name server /root on")).then_some(())
        })?;
        Ok(server)
    }

    /// Starts `wrapyfi` with these arguments and another `RMW_IMPLEMENTATION`.
    pub fn wrapyfi_as(&self, rmw: &str, args: impl Args) -> Result<Process> {
        let mut command = self.command(&programs::program()?, args);
        command.env("RMW_IMPLEMENTATION", rmw);
        self.start("wrapyfi", command)
    }

    /// Starts the node executable with these arguments.
    pub fn node(&self, args: impl Args) -> Result<Process> {
        Ok(self.start("bridge", self.command(&self.node_program("bridge")?, args))?.pillar())
    }

    fn node_program(&self, name: &str) -> Result<PathBuf> {
        programs::node_in(self.folder.path(), name)
    }

    /// Starts a node executable that bridges all of a middleware, by its name, with these ROS arguments.
    pub fn executable(&self, name: &str, ros_args: &[&str]) -> Result<Process> {
        let args = ["--ros-args"].iter().chain(ros_args);
        let command = self.command(&self.node_program(name)?, args);
        Ok(self.start(name, command)?.pillar())
    }

    /// Starts the node executable with these routes and more ROS arguments.
    pub fn node_with(&self, routes: Vec<Route>, ros_args: &[&str]) -> Result<Process> {
        let config = routes.into_iter().fold(self.embedded(), Config::route);
        let file = self.write("bridge.yaml", config.yaml())?;
        let parameter = format!("config_file:={}", file.display());
        let mut args = vec!["--ros-args", "-p", &parameter];
        args.extend(ros_args);
        self.node(args)
    }

    /// Starts the node executable with these arguments and another `RMW_IMPLEMENTATION`.
    pub fn node_as(&self, rmw: &str, args: impl Args) -> Result<Process> {
        let mut command = self.command(&self.node_program("bridge")?, args);
        command.env("RMW_IMPLEMENTATION", rmw);
        Ok(self.start("bridge", command)?.pillar())
    }

    /// Starts the example `pose_mirror` with these topics.
    pub fn pose_mirror(&self, from: &str, to: &str) -> Result<Process> {
        let command = self.command(&programs::executable("pose_mirror")?, [from, to]);
        Ok(self.start("pose_mirror", command)?.pillar())
    }

    /// Starts a program of `examples/communicator`; `args` are split at blanks.
    pub fn example(&self, name: &str, args: &str) -> Result<Process> {
        let mut command = self.command(&programs::executable(name)?, args.split_whitespace());
        self.cross_ports(&mut command, args);
        self.start(name, command)
    }

    /// Starts `wrapyfi bridge --json` with this configuration.
    pub fn bridge(&self, config: &Config) -> Result<Process> {
        self.bridge_named("bridge.yaml", config)
    }

    /// As [`TestEnv::bridge`], for several at once: each has its own file.
    pub fn bridge_named(&self, file: &str, config: &Config) -> Result<Process> {
        let file = self.write(file, config.yaml())?;
        let args =
            [OsStr::new("bridge"), OsStr::new("--config"), file.as_os_str(), OsStr::new("--json")];
        Ok(self.wrapyfi(args)?.pillar())
    }

    /// A configuration with our own broker on this test's ports.
    pub fn embedded(&self) -> Config {
        Config::embedded(self.pub_port(), self.sub_port())
    }

    /// A configuration that uses another program's broker on this test's ports.
    pub fn foreign(&self) -> Config {
        Config::foreign(self.pub_port(), self.sub_port())
    }

    /// Starts our broker on this test's ports.
    pub fn broker(&self) -> Result<Process> {
        self.broker_at(self.pub_port(), self.sub_port())
    }

    /// Starts our broker on these ports.
    pub fn broker_at(&self, pub_port: u16, sub_port: u16) -> Result<Process> {
        let (pub_port, sub_port) = (pub_port.to_string(), sub_port.to_string());
        let args = ["broker", "--pub-port", &pub_port, "--sub-port", &sub_port];
        let broker = self.wrapyfi(args)?.pillar();
        // A program that starts a broker where there is none must find this one.
        broker.wait_until("the ports to be bound", |output| {
            output.err.iter().any(|line| line.contains("listeners connect to port")).then_some(())
        })?;
        Ok(broker)
    }

    /// Starts `wrapyfi broker` on this test's ports, whatever becomes of it.
    pub fn broker_that_may_fail(&self) -> Result<Process> {
        let (pub_port, sub_port) = (self.pub_port().to_string(), self.sub_port().to_string());
        self.wrapyfi(["broker", "--pub-port", &pub_port, "--sub-port", &sub_port])
    }

    /// Starts a Python peer from `test/peers`; `args` are split at blanks.
    pub fn peer(&self, script: &str, args: &str) -> Result<Process> {
        self.start(script, self.peer_command(script, args)?)
    }

    /// Starts Wrapyfi's peer on YARP's bindings; `args` are split at blanks.
    pub fn wrapyfi_on_yarp(&self, args: &str) -> Result<Process> {
        let mut command = self.peer_command("wrapyfi_peer.py", args)?;
        command.env("PYTHONPATH", installation::yarp_for_python()?);
        self.start("wrapyfi_peer.py", command)
    }

    /// As [`TestEnv::peer`], with the package `wrapyfi_rs` in place of Wrapyfi.
    pub fn our_peer(&self, script: &str, args: &str) -> Result<Process> {
        let file = repository().join("test/peers").join(script).display().to_string();
        let mut command =
            self.our_python(format!("-m wrapyfi_rs {file} {args}").split_whitespace())?;
        self.cross_ports(&mut command, args);
        self.start(script, command)
    }

    /// Runs a script of `examples/python`; `args` are split at blanks.
    pub fn our_example(&self, script: &str, args: &str) -> Result<Process> {
        let file = repository().join("examples/python").join(script).display().to_string();
        let mut command = self.our_python(format!("{file} {args}").split_whitespace())?;
        self.cross_ports(&mut command, &format!("--mode {args}"));
        self.start(script, command)
    }

    /// Runs a module with the package `wrapyfi_rs` in place of Wrapyfi; `args` are split at blanks.
    pub fn our_module(&self, module: &str, args: &str) -> Result<Process> {
        let mut command =
            self.our_python(format!("-m wrapyfi_rs -m {module} {args}").split_whitespace())?;
        self.cross_ports(&mut command, args);
        self.start(module, command)
    }

    /// Starts a script of this text with the package `wrapyfi_rs`; `args` are split at blanks.
    pub fn our_script(&self, text: &str, args: &str) -> Result<Process> {
        let file = self.write(&format!("script_{:x}.py", hash(text)), text)?;
        let mut command =
            self.our_python(format!("{} {args}", file.display()).split_whitespace())?;
        self.cross_ports(&mut command, &format!("--mode {args}"));
        self.start("script.py", command)
    }

    /// Starts the interpreter of Wrapyfi where the package `wrapyfi_rs` is installed beside it, with these variables.
    pub fn our_python_with(&self, args: &[&str], variables: &[(&str, &str)]) -> Result<Process> {
        let mut command = self.our_python(args.iter().copied())?;
        command.envs(variables.iter().copied());
        self.start("python", command)
    }

    /// Installs the package `wrapyfi_rs` for the interpreters that are started from now on.
    pub fn install_python_package(&self) -> Result {
        self.set_variable("PYTHONPATH", self.python_package()?);
        Ok(())
    }

    /// Folder in which interpreters find the package `wrapyfi_rs`.
    pub fn python_package(&self) -> Result<PathBuf> {
        programs::python_package(self.folder.path())
    }

    fn our_python(&self, args: impl Args) -> Result<Command> {
        let mut command = self.command(&programs::python()?, args);
        command.env("PYTHONPATH", self.python_package()?);
        command.env("PYTHONUNBUFFERED", "1");
        Ok(command)
    }

    pub(crate) fn peer_command(&self, script: &str, args: &str) -> Result<Command> {
        let file = repository().join("test/peers").join(script).into_os_string();
        let all = std::iter::once(file).chain(args.split_whitespace().map(Into::into));
        let mut command = self.command(&programs::python()?, all);
        // Python decides by locale otherwise; and a .pyc beside the source would show up in git.
        self.cross_ports(&mut command, args);
        Ok(command)
    }

    /// Starts the peer on Fast DDS; `args` are split at blanks.
    pub fn fast_peer(&self, args: &str) -> Result<Process> {
        let command = self.command(&cpp::FAST_DDS.or_why_not()?, args.split_whitespace());
        self.start("fast_peer", command)
    }

    /// Starts the Python script of the example of a plug-in.
    pub fn poses(&self, there: &str, back: &str) -> Result<Process> {
        let folder = repository().join("examples/pose_plugin/python");
        let args = [folder.join("poses.py").into_os_string(), there.into(), back.into()];
        let mut command = self.command(&programs::python()?, args);
        command.env("WRAPYFI_PLUGIN_PATHS", folder);
        self.start("poses.py", command)
    }

    /// Starts a real Wrapyfi publisher that goes on until it is dropped. `args` says type and flavour.
    pub fn wrapyfi_publisher(&self, topic: &str, args: &str) -> Result<Process> {
        let (pub_port, sub_port) = (self.pub_port(), self.sub_port());
        let args =
            format!("publish --topic {topic} --pub-port {pub_port} --sub-port {sub_port} {args}");
        self.peer("wrapyfi_peer.py", &args)
    }

    /// Starts a real Wrapyfi listener. `args` says type, flavour and perhaps `--count`.
    pub fn wrapyfi_listener(&self, topic: &str, args: &str) -> Result<Process> {
        let pub_port = self.pub_port();
        let args = format!("listen --topic {topic} --pub-port {pub_port} {args}");
        self.peer("wrapyfi_peer.py", &args)
    }

    /// Starts a real Wrapyfi client, whose calls have one payload as their argument. `args` says type,
    /// flavour and `--count`.
    pub fn wrapyfi_client(&self, args: &str) -> Result<Process> {
        let rep_port = self.rep_port();
        let args = format!("request --topic /unused --rep-port {rep_port} {args}");
        self.peer("wrapyfi_peer.py", &args)
    }

    /// Starts a real Wrapyfi server that goes on until it is dropped, with its broker. `args` says
    /// type and flavour.
    pub fn wrapyfi_server(&self, args: &str) -> Result<Process> {
        let (rep_port, req_port) = (self.rep_port(), self.req_port());
        let args =
            format!("reply --topic /unused --rep-port {rep_port} --req-port {req_port} {args}");
        self.peer("wrapyfi_peer.py", &args)
    }

    /// Port of this test's ROS 1 master.
    pub fn ros_port(&self) -> u16 {
        self.ros_port.number
    }

    /// Address of this test's ROS 1 master.
    pub fn ros_master_uri(&self) -> String {
        format!("http://127.0.0.1:{}", self.ros_port.number)
    }

    /// Starts a peer on rospy from `test/peers`, with the system's Python; `args` are split at
    /// blanks, `value` is its `--value` as it is.
    pub fn rospy(&self, args: &str, value: Option<&str>) -> Result<Process> {
        self.start("rospy_peer.py", self.rospy_command(args, value))
    }

    /// Starts a server or a client of actions on rospy's actionlib: `test/peers/rospy_actions.py`.
    pub fn rospy_actions(&self, args: &str) -> Result<Process> {
        self.start("rospy_actions.py", self.system_python("rospy_actions.py", args, None))
    }

    /// Starts a server or a client of dynamic_reconfigure: `test/peers/reconfigure_peer.py`.
    pub fn reconfigure(&self, args: &str) -> Result<Process> {
        self.start("reconfigure_peer.py", self.system_python("reconfigure_peer.py", args, None))
    }

    /// Runs `test/peers/rosbag_write.py`, which writes bags with rosbag; `args` are split at blanks.
    pub fn rosbag(&self, args: &str) -> Result<Process> {
        self.start("rosbag_write.py", self.system_python("rosbag_write.py", args, None))
    }

    pub(crate) fn rospy_command(&self, args: &str, value: Option<&str>) -> Command {
        self.system_python("rospy_peer.py", args, value)
    }

    fn system_python(&self, file: &str, args: &str, value: Option<&str>) -> Command {
        let file = repository().join("test/peers").join(file).into_os_string();
        let mut all: Vec<std::ffi::OsString> = vec![file];
        all.extend(args.split_whitespace().map(Into::into));
        if let Some(value) = value {
            all.extend(["--value".into(), value.into()]);
        }
        self.command(Path::new(programs::SYSTEM_PYTHON), all)
    }

    /// Starts a server or a client of actionlib in Python; `args` are split at blanks.
    pub fn actionlib(&self, args: &str) -> Result<Process> {
        let file = repository().join("test/peers/actionlib_peer.py");
        let file = file.to_string_lossy().into_owned();
        let args = std::iter::once(file.as_str()).chain(args.split_whitespace());
        self.start("actionlib_peer.py", self.command(Path::new(programs::SYSTEM_PYTHON), args))
    }

    /// As [`TestEnv::actionlib`], in C++.
    pub fn actionlib_cpp(&self, args: &str) -> Result<Process> {
        let command = self.command(&cpp::ACTIONLIB.or_why_not()?, args.split_whitespace());
        self.start("actionlib_cpp", command)
    }

    /// Starts a node of roscpp; `args` are split at blanks, `value` is its `--value` as it is.
    pub fn roscpp(&self, args: &str, value: Option<&str>) -> Result<Process> {
        let program = cpp::ROSCPP.or_why_not()?;
        let value = value.into_iter().flat_map(|value| ["--value", value]);
        let command = self.command(&program, args.split_whitespace().chain(value));
        self.start("ros1_cpp", command)
    }

    /// Starts Debian's ROS 1 master on this test's port.
    pub fn roscore(&self) -> Result<Process> {
        let roscore = self.rospy(&format!("master --port {}", self.ros_port.number), None)?;
        roscore.event("ready")?;
        Ok(roscore)
    }

    /// Registrations at this test's ROS 1 master.
    pub fn ros_books(&self) -> Result<Books> {
        Books::ask(self.ros_port.number)
    }

    /// Runs a tool of ROS 1, such as `rostopic`; `args` are split at blanks.
    pub fn ros_tool(&self, tool: &str, args: &str) -> Result<Process> {
        let mut command =
            self.command(Path::new("/usr/bin").join(tool).as_path(), args.split_whitespace());
        command.env("PYTHONUNBUFFERED", "1");
        self.start(tool, command)
    }

    /// Starts a DDS subscriber on CycloneDDS.
    pub fn dds_subscriber(&self, topic: &str, ros_type: &str, args: &str) -> Result<Process> {
        self.peer("cyclone_peer.py", &format!("subscribe --topic {topic} --type {ros_type} {args}"))
    }

    /// Starts a DDS publisher on CycloneDDS that goes on until it is dropped.
    pub fn dds_publisher(&self, topic: &str, ros_type: &str, args: &str) -> Result<Process> {
        self.peer("cyclone_peer.py", &format!("publish --topic {topic} --type {ros_type} {args}"))
    }

    /// Starts an observer of the ROS 2 graph.
    pub fn graph(&self) -> Result<Process> {
        self.peer("cyclone_peer.py", "graph")
    }

    /// A ros2-client node on this test's domain.
    pub fn ros_node(&self, name: &str) -> Result<RosNode> {
        RosNode::new(self.domain.number, name)
    }

    /// Gives a program that is a client its port, which clients and servers call by different names.
    fn cross_ports(&self, command: &mut Command, args: &str) {
        if ["--mode request", "--request"].iter().any(|mode| args.contains(mode))
            || args == "request"
            || args.starts_with("wrapyfi call")
        {
            command.env("WRAPYFI_ZEROMQ_SOCKET_REP_PORT", self.rep_port().to_string());
        }
    }

    /// Starts one of YARP's tools, as installed; it finds the name server by this test's `yarp.conf`.
    pub fn yarp_tool(&self, tool: &str, args: &[&str]) -> Result<Process> {
        self.start(tool, self.yarp_command(tool, args)?)
    }

    pub(crate) fn yarp_command(&self, tool: &str, args: &[&str]) -> Result<Command> {
        let mut command = self.command(&installation::yarp_tools()?.join(tool), args);
        command.env("YARP_FORWARD_LOG_ENABLE", "0").env("YARP_COLORED_OUTPUT", "0");
        command.env("YARP_DATA_DIRS", installation::yarp_data()?);
        Ok(command)
    }

    /// Starts the robot of YARP, whose rpc port has this name.
    pub fn yarp_robot(&self, port: &str) -> Result<Process> {
        let mut command = self.command(&cpp::YARP.or_why_not()?, [port]);
        command.env("YARP_FORWARD_LOG_ENABLE", "0").env("YARP_COLORED_OUTPUT", "0");
        self.start("yarp_robot", command)
    }

    /// Starts the interpreter that has Wrapyfi.
    pub fn python(&self, args: &[&str]) -> Result<Process> {
        let mut command = self.command(&programs::python()?, args);
        self.cross_ports(&mut command, &args.join(" "));
        self.start("python", command)
    }

    /// Starts Chromium without a screen and with a profile of its own; it looks for nothing elsewhere.
    pub fn chromium(&self, args: &[&str]) -> Result<Process> {
        let profile = format!("--user-data-dir={}", self.path("chromium").display());
        let own =
            ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-sync"];
        let quiet = ["--disable-background-networking", "--disable-component-update", &profile];
        let all = own.into_iter().chain(quiet).chain(args.iter().copied());
        let command = self.command(&programs::chromium()?, all);
        self.start("chromium", command)
    }

    /// Starts a line of the shell, as a user types it who has our programs and the Python peers on the `PATH`.
    pub fn shell(&self, line: &str) -> Result<Process> {
        let mut command = self.command(Path::new("bash"), ["-c", line]);
        // As `make build` and colcon leave them: links beside the program.
        let links = self.path("links");
        std::fs::create_dir_all(&links)?;
        for name in programs::NODES {
            programs::node_in(&links, name)?;
        }
        let programs = programs::program()?;
        let python = programs::python().ok();
        let own = std::iter::once(programs).chain(python);
        let own = own.filter_map(|file| file.parent().map(Path::to_owned)).chain([links]);
        let others = std::env::var_os("PATH").unwrap_or_default();
        let path = std::env::join_paths(own.chain(std::env::split_paths(&others)))?;
        command.env("PATH", path).env("PYTHONUNBUFFERED", "1");
        self.cross_ports(&mut command, line);
        self.start(line, command)
    }

    /// Starts the script of a broken set-up, a folder of `test/broken`, which has a network of its own.
    pub fn broken(&self, folder: &str) -> Result<Process> {
        let script = repository().join("test/broken").join(folder).join("run.sh");
        let mut command = self.command(&script, ["--json"]);
        command.env("WRAPYFI_BIN", programs::program()?);
        if let Ok(python) = programs::python() {
            command.env("WRAPYFI_PYTHON", python);
        }
        if let Ok(program) = cpp::FAST_DDS.or_why_not() {
            command.env("WRAPYFI_FAST_PEER", program);
        }
        self.start(folder, command)
    }

    /// Starts a command of this test.
    pub(crate) fn start(&self, name: &str, command: Command) -> Result<Process> {
        Process::start(name, command, &self.pillars)
    }

    /// A command that sees this test's domain and ports, and only the loopback interface.
    pub(crate) fn command(&self, program: &Path, args: impl Args) -> Command {
        let mut command = Command::new(program);
        command
            .args(args)
            .current_dir(self.folder.path())
            .env("ROS_DOMAIN_ID", self.domain.number.to_string())
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            .env("CYCLONEDDS_URI", LOOPBACK)
            .env("RMW_IMPLEMENTATION", rmw())
            .env("WRAPYFI_ZEROMQ_SOCKET_IP", "127.0.0.1")
            .env("WRAPYFI_ZEROMQ_SOCKET_PUB_PORT", self.pub_port().to_string())
            .env("WRAPYFI_ZEROMQ_SOCKET_SUB_PORT", self.sub_port().to_string())
            // As Wrapyfi's servers read them; for its clients the first has another meaning.
            .env("WRAPYFI_ZEROMQ_SOCKET_REP_PORT", self.req_port().to_string())
            .env("WRAPYFI_ZEROMQ_SOCKET_REQ_PORT", self.rep_port().to_string())
            .env("ROS_MASTER_URI", self.ros_master_uri())
            .env("ROS_IP", "127.0.0.1")
            .env("ROS_HOME", self.folder.path())
            .env("ROS_LOG_DIR", self.folder.path())
            .env("YARP_CONFIG_HOME", self.folder.path())
            .env("NO_COLOR", "1")
            .env("PYTHONUTF8", "1")
            .env("PYTHONDONTWRITEBYTECODE", "1");
        for variable in [
            // Of a ROS 2 that is sourced: its messages have the names of those of ROS 1.
            "PYTHONPATH",
            "ROS_LOCALHOST_ONLY",
            "ROS_STATIC_PEERS",
            "ROS_DISTRO",
            "ROS_HOSTNAME",
            "ROS_NAMESPACE",
            "RUST_LOG",
            "WRAPYFI_ROS_INSECURE",
            "WRAPYFI_YARP_INSECURE",
            "WRAPYFI_ZEROMQ_INSECURE",
            "YARP_IP",
        ] {
            command.env_remove(variable);
        }
        command.envs(&*self.variables());
        command
    }
}

fn hash(text: &str) -> u64 {
    let mut hasher = std::hash::DefaultHasher::new();
    text.hash(&mut hasher);
    hasher.finish()
}

/// The middleware of ROS 2 of programs that name none: `WRAPYFI_TEST_RMW`, else CycloneDDS.
#[must_use]
pub fn rmw() -> String {
    std::env::var("WRAPYFI_TEST_RMW").unwrap_or_else(|_| "rmw_cyclonedds_cpp".to_owned())
}
