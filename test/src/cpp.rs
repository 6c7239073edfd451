//! The peers in C++: compiled once from `test/peers/<name>`, then started like the others.
//!
//! ```text
//!   main.cpp, *.hpp ─ c++ ─▶ target/<profile>/<name>/<hash of them>   under a lock, once
//! ```

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use anyhow::{Context as _, bail};

use crate::{Result, repository, sha256};

/// Reason why a compiled peer is missing.
#[derive(Debug, Clone)]
pub(crate) enum Absent {
    /// Missing library: this system has none to compile the peer with.
    Library(String),
    /// Missing program: it should be there and is not.
    Program(String),
}

type Found = std::result::Result<PathBuf, Absent>;

/// A peer that is compiled.
pub(crate) struct Peer {
    /// Folder of the peer in `test/peers`, and its name in messages.
    name: &'static str,
    /// All of its source.
    files: &'static [&'static str],
    /// Lines that compile where the library is there, in the version that is wanted.
    probe: &'static str,
    libraries: &'static [&'static str],
    /// Variable with the folder where the library is installed, where that is not the system's.
    prefix: Option<&'static str>,
    /// Library or program that is missing elsewhere, and its remedy.
    missing: &'static str,
    found: OnceLock<Found>,
}

/// The peer on Fast DDS 2. The headers are those that Fast DDS 2 has, and neither 1 nor 3.
pub(crate) static FAST_DDS: Peer = Peer {
    name: "fast_peer",
    files: &["main.cpp", "discovery.hpp", "talk.hpp", "types.hpp"],
    probe: "#include <fastdds/dds/domain/DomainParticipant.hpp>\n\
            #include <fastrtps/utils/IPLocator.h>\n",
    libraries: &["-lfastrtps", "-lfastcdr"],
    prefix: None,
    missing: "no Fast DDS 2 for C++ (Debian 12: libfastrtps-dev, libfastcdr-dev); run `make test` \
              where the system has it",
    found: OnceLock::new(),
};

/// The node of roscpp.
pub(crate) static ROSCPP: Peer = Peer {
    name: "ros1_cpp",
    files: &["main.cpp", "talk.hpp"],
    probe: "#include <ros/ros.h>\n#include <std_msgs/String.h>\n\
            #include <sensor_msgs/Image.h>\n#include <std_srvs/SetBool.h>\n",
    libraries: &[
        "-lroscpp",
        "-lroscpp_serialization",
        "-lrosconsole",
        "-lrostime",
        "-lcpp_common",
        "-lboost_system",
        "-lboost_thread",
    ],
    prefix: None,
    missing: "no roscpp (Debian 12: libroscpp-dev, libsensor-msgs-dev, libstd-msgs-dev, \
              libstd-srvs-dev); run `make test` where the system has it",
    found: OnceLock::new(),
};

/// The node of actionlib in C++.
pub(crate) static ACTIONLIB: Peer = Peer {
    name: "actionlib_cpp",
    files: &["main.cpp", "../ros1_cpp/talk.hpp"],
    probe: "#include <actionlib/TestAction.h>\n#include <actionlib/server/simple_action_server.h>\n",
    libraries: &[
        "-lactionlib",
        "-lroscpp",
        "-lroscpp_serialization",
        "-lrosconsole",
        "-lrostime",
        "-lcpp_common",
        "-lboost_system",
        "-lboost_thread",
    ],
    prefix: None,
    missing: "no actionlib for C++ (Debian 12: libactionlib-dev); run `make test` where the system \
              has it",
    found: OnceLock::new(),
};

/// The robot of YARP.
pub(crate) static YARP: Peer = Peer {
    name: "yarp_robot",
    files: &["main.cpp"],
    probe: "#include <yarp/os/RpcServer.h>\n",
    libraries: &["-lYARP_init", "-lYARP_os"],
    prefix: Some("WRAPYFI_YARP_PREFIX"),
    missing: "no headers of YARP: neither below WRAPYFI_YARP_PREFIX nor of the system",
    found: OnceLock::new(),
};

fn compiler() -> Command {
    Command::new(std::env::var_os("CXX").unwrap_or_else(|| "c++".into()))
}

impl Peer {
    /// The program.
    pub(crate) fn program(&self) -> Found {
        self.found.get_or_init(|| self.find()).clone()
    }

    /// The program, or in words why there is none.
    pub(crate) fn or_why_not(&self) -> Result<PathBuf> {
        self.program().map_err(|absent| match absent {
            Absent::Library(reason) | Absent::Program(reason) => anyhow::Error::msg(reason),
        })
    }

    /// True where this system has nothing to compile it with, so that its absence is no fault.
    pub(crate) fn lacks_library(&self) -> bool {
        matches!(self.program(), Err(Absent::Library(_)))
    }

    fn find(&self) -> Found {
        let wrong = |error: anyhow::Error| Absent::Program(format!("{}: {error:#}", self.name));
        let (source, program) = self.places().map_err(wrong)?;
        if program.is_file() {
            return Ok(program);
        }
        if !self.has_library(&program).map_err(wrong)? {
            return Err(Absent::Library(self.missing.to_owned()));
        }
        self.compile(&source, &program).map_err(wrong)?;
        Ok(program)
    }

    /// The source, and the program made of it: another source is another program.
    fn places(&self) -> Result<(PathBuf, PathBuf)> {
        let sources = repository().join("test/peers").join(self.name);
        let mut text = Vec::new();
        for name in self.files {
            let file = sources.join(name);
            text.extend(
                std::fs::read(&file).with_context(|| format!("reading {}", file.display()))?,
            );
        }
        let own = std::env::current_exe()?;
        let folder =
            own.ancestors().nth(2).context("the test runs outside a Cargo build folder")?;
        let folder = folder.join(self.name);
        std::fs::create_dir_all(&folder)
            .with_context(|| format!("creating {}", folder.display()))?;
        let hash = sha256(&text);
        Ok((sources.join("main.cpp"), folder.join(hash.get(..16).unwrap_or(&hash))))
    }

    /// The compiler, which finds the library.
    fn compiler(&self) -> Command {
        let mut command = compiler();
        if let Some(prefix) = self.prefix.and_then(std::env::var_os) {
            let folder = |name: &str| Path::new(&prefix).join(name).display().to_string();
            let library = folder("lib");
            command.args([format!("-I{}", folder("include")), format!("-L{library}")]);
            command.arg(format!("-Wl,-rpath,{library}"));
        }
        command
    }

    fn has_library(&self, program: &Path) -> Result<bool> {
        let probe = program.with_extension(format!("{}.hpp", std::process::id()));
        std::fs::write(&probe, self.probe)?;
        let ran = self.compiler().args(["-x", "c++", "-E", "-o", "/dev/null"]).arg(&probe).output();
        std::fs::remove_file(&probe)?;
        Ok(ran.context("starting the C++ compiler")?.status.success())
    }

    /// Compiles it, unless another test does: the lock ends with the file.
    fn compile(&self, source: &Path, program: &Path) -> Result {
        let lock = File::create(program.with_extension("lock"))?;
        lock.lock().context("waiting for the test that compiles it")?;
        if program.is_file() {
            return Ok(());
        }
        let unfinished = program.with_extension("part");
        let mut command = self.compiler();
        command.args(["-std=c++17", "-O1", "-o"]).arg(&unfinished).arg(source);
        command.args(self.libraries).arg("-pthread");
        let ran = command.output().context("starting the C++ compiler")?;
        if !ran.status.success() {
            let said = String::from_utf8_lossy(&ran.stderr);
            bail!("{command:?} failed:\n{}", said.lines().take(20).collect::<Vec<_>>().join("\n"));
        }
        // Whole or not at all: a test that finds it starts it.
        std::fs::rename(&unfinished, program)?;
        Ok(())
    }
}
