//! Machines of a test: network namespaces with an address, a host name and an `/etc/hosts` each, joined
//! by a bridge.
//!
//! ```text
//!   robot 10.77.0.1 ── veth ──┐
//!   laptop 10.77.0.2 ─ veth ──┼── bridge, in a namespace of its own      nothing else is reached
//!   desk 10.77.0.3 ─── veth ──┘
//! ```
//!
//! A machine knows its own name and no other. Its namespaces end with the process that holds them.

use std::ffi::OsStr;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;

use anyhow::{Context as _, bail};

use crate::{Args, Process, Result, TestEnv, programs};

/// One machine.
#[derive(Debug)]
pub struct Host<'w> {
    env: &'w TestEnv,
    holder: Holder,
    ip: String,
    environment: Vec<(String, String)>,
    /// Network bridge that joins the machine to the others, and the machine's socket there.
    switch: Arc<Holder>,
    socket: String,
}

/// A process in namespaces of its own, which exist as long as it does.
#[derive(Debug)]
struct Holder(Child);

impl Holder {
    /// Runs `setup` in new namespaces and stays in them.
    fn new(setup: &str) -> Result<Self> {
        let mut child = Command::new("unshare")
            .args(["--net", "--uts", "--mount", "sh", "-c"])
            .arg(format!("{setup} && echo ready && exec cat"))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .context("starting unshare")?;
        let mut said = String::new();
        if let Some(stdout) = child.stdout.take() {
            BufReader::new(stdout).read_line(&mut said)?;
        }
        let holder = Self(child);
        if said.trim() != "ready" {
            bail!("no network namespaces here (they need root and iproute2)");
        }
        Ok(holder)
    }

    /// A command in these namespaces, in this folder.
    fn enter(&self, folder: &Path, program: &OsStr) -> Command {
        let mut command = Command::new("nsenter");
        for kind in ["net", "uts", "mnt"] {
            let option = if kind == "mnt" { "mount" } else { kind };
            command.arg(format!("--{option}=/proc/{}/ns/{kind}", self.0.id()));
        }
        // Another mount namespace begins at its root.
        command.arg(format!("--wd={}", folder.display())).arg("--").arg(program);
        command
    }

    fn run(&self, program: &str, args: &str) -> Result {
        let ran =
            self.enter(Path::new("/"), program.as_ref()).args(args.split_whitespace()).output()?;
        if !ran.status.success() {
            bail!("{program} {args}: {}", String::from_utf8_lossy(&ran.stderr).trim());
        }
        Ok(())
    }
}

impl Drop for Holder {
    fn drop(&mut self) {
        // Nothing is left to do about a failure here.
        let _killed: std::io::Result<()> = self.0.kill();
        let _status: std::io::Result<_> = self.0.wait();
    }
}

/// Checks that machines can be made here.
pub(crate) fn or_why_not() -> Result {
    let made = Holder::new(
        "ip link add name br0 type bridge && ip link add name v0 type veth peer name v1",
    );
    made.map(drop)
}

impl TestEnv {
    /// Machines of these names, which reach one another.
    pub fn hosts<const N: usize>(&self, names: [&str; N]) -> Result<[Host<'_>; N]> {
        let switch = Holder::new("ip link add name br0 type bridge && ip link set br0 up")?;
        let switch = Arc::new(switch);
        let mut hosts = Vec::new();
        for (index, name) in names.iter().enumerate() {
            let ip = format!("10.77.0.{}", index + 1);
            let known = format!("127.0.0.1 localhost\n{ip} {name}\n");
            let file = self.write(&format!("hosts_{name}"), known)?;
            let file = file.display();
            let holder = Holder::new(&format!(
                "hostname {name} && mount --make-rprivate / && mount --bind {file} /etc/hosts \
                 && ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo"
            ))?;
            let link =
                format!("link add name v{index} type veth peer name eth0 netns {}", holder.0.id());
            switch.run("ip", &link)?;
            switch.run("ip", &format!("link set v{index} master br0 up"))?;
            holder.run("ip", &format!("addr add {ip}/24 dev eth0"))?;
            holder.run("ip", "link set eth0 up")?;
            let (environment, switch) = (Vec::new(), Arc::clone(&switch));
            let socket = format!("v{index}");
            hosts.push(Host { env: self, holder, ip, environment, switch, socket });
        }
        hosts.try_into().map_err(|_hosts| anyhow::anyhow!("not {N} machines"))
    }
}

impl Host<'_> {
    /// Address of the machine.
    pub fn ip(&self) -> &str {
        &self.ip
    }

    /// Puts its cable into the switch, or takes it out: the other machines notice nothing by themselves.
    pub fn plug(&self, plugged: bool) -> Result {
        let state = if plugged { "up" } else { "down" };
        self.switch.run("ip", &format!("link set {} {state}", self.socket))
    }

    /// The same, where programs that are started from now on see this variable.
    #[must_use]
    pub fn with(mut self, name: &str, value: &str) -> Self {
        self.environment.push((name.to_owned(), value.to_owned()));
        self
    }

    /// Starts `wrapyfi` here.
    pub fn wrapyfi(&self, args: impl Args) -> Result<Process> {
        self.start("wrapyfi", &self.env.command(&programs::program()?, args))
    }

    /// Starts a Python peer from `test/peers` here; `args` are split at blanks.
    pub fn peer(&self, script: &str, args: &str) -> Result<Process> {
        self.start(script, &self.env.peer_command(script, args)?)
    }

    /// Starts a program of `examples/communicator` here; `args` are split at blanks.
    pub fn example(&self, name: &str, args: &str) -> Result<Process> {
        self.start(name, &self.env.command(&programs::executable(name)?, args.split_whitespace()))
    }

    /// Starts a peer on rospy here; `args` are split at blanks.
    pub fn rospy(&self, args: &str) -> Result<Process> {
        self.start("rospy_peer.py", &self.env.rospy_command(args, None))
    }

    /// Starts a program of YARP's own here.
    pub fn yarp_tool(&self, tool: &str, args: &[&str]) -> Result<Process> {
        self.start(tool, &self.env.yarp_command(tool, args)?)
    }

    /// Starts any program here; `args` are split at blanks.
    pub fn program(&self, program: &str, args: &str) -> Result<Process> {
        self.start(program, &self.env.command(program.as_ref(), args.split_whitespace()))
    }

    fn start(&self, name: &str, command: &Command) -> Result<Process> {
        let folder = command.get_current_dir().unwrap_or(Path::new("/"));
        let mut inside = self.holder.enter(folder, command.get_program());
        inside.args(command.get_args());
        for (key, value) in command.get_envs() {
            match value {
                Some(value) => inside.env(key, value),
                None => inside.env_remove(key),
            };
        }
        for (key, value) in &self.environment {
            match value.as_str() {
                "" => inside.env_remove(key),
                value => inside.env(key, value),
            };
        }
        self.env.start(name, inside)
    }
}
