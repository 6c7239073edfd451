//! Program of this machine that has a port, for messages about a port that is taken.

use std::fs;

/// Longest text of a program in a message, in characters.
const SHOWN: usize = 120;
/// State of a socket that listens, in the tables of the kernel.
const LISTENS: &str = "0A";

/// Program that listens at a TCP port, such as ``process 4711, `wrapyfi bridge` ``; `None` where the system does not
/// tell, as of processes of other users.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::network::owner;
/// let taken = std::net::TcpListener::bind("127.0.0.1:0")?;
/// if let Some(this_program) = owner(taken.local_addr()?.port()) {
///     assert!(this_program.starts_with(&format!("process {}", std::process::id())));
/// }
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn owner(port: u16) -> Option<Box<str>> {
    let tables = ["tcp", "tcp6"].map(|name| fs::read_to_string(format!("/proc/self/net/{name}")));
    let sockets: Vec<_> = tables
        .iter()
        .flatten()
        .flat_map(|table| table.lines().skip(1))
        .filter_map(|line| listener(line, port))
        .map(|inode| format!("socket:[{inode}]"))
        .collect();
    if sockets.is_empty() {
        return None;
    }
    let processes = fs::read_dir("/proc").ok()?.flatten();
    let mut owners = processes.filter_map(|process| {
        let pid: u32 = process.file_name().to_str()?.parse().ok()?;
        // Those of other users cannot be read.
        let mut open = fs::read_dir(process.path().join("fd")).ok()?.flatten();
        let is_it = |to: &str| sockets.iter().any(|socket| socket == to);
        open.any(|file| fs::read_link(file.path()).is_ok_and(|to| to.to_str().is_some_and(is_it)))
            .then(|| {
                let line = fs::read(process.path().join("cmdline")).unwrap_or_default();
                let line = String::from_utf8_lossy(&line).replace(|it: char| it.is_control(), " ");
                let line: String = line.trim_end().chars().take(SHOWN).collect();
                format!("process {pid}, `{line}`").into()
            })
    });
    owners.next()
}

/// Number of the socket in a line of a table, where that socket listens at the port.
fn listener(line: &str, port: u16) -> Option<&str> {
    let columns: Vec<_> = line.split_whitespace().collect();
    let [_, local, _, LISTENS, _, _, _, _, _, inode, ..] = *columns else { return None };
    let (_, at) = local.rsplit_once(':')?;
    (u16::from_str_radix(at, 16) == Ok(port)).then_some(inode)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_program_of_a_port_is_named() {
        let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let port = taken.local_addr().unwrap().port();
        let this_program = owner(port).unwrap();
        assert!(this_program.contains(&std::process::id().to_string()), "{this_program}");
        drop(taken);
        assert_eq!(owner(port), None);
    }
}
