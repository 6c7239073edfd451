//! Completions of shells and manual pages, both made from the definition of the command line.

use std::path::Path;

use anyhow::Context as _;
use clap::CommandFactory as _;
use clap_complete::Shell;

use crate::cli::Cli;
use crate::exit::Result;
use crate::output;

/// Prints the completions of a shell.
///
/// # Errors
/// Standard output cannot be written.
pub fn print(shell: Shell) -> Result<()> {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "wrapyfi", &mut text);
    output::line(String::from_utf8_lossy(&text).trim_end())
}

/// Writes `wrapyfi.1` and a page for each command, `wrapyfi-demo.1`, into a folder, which is made where it is missing.
///
/// # Errors
/// The folder or a page cannot be written.
pub fn write_pages(folder: &Path) -> Result<()> {
    let written = std::fs::create_dir_all(folder)
        .and_then(|()| clap_mangen::generate_to(Cli::command(), folder));
    Ok(written.with_context(|| format!("cannot write pages into {}", folder.display()))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_command_has_a_page_with_its_options() {
        let folder = tempfile::tempdir().unwrap();
        let pages = folder.path().join("man1");
        write_pages(&pages).unwrap();
        let shown = Cli::command();
        let shown: Vec<_> = shown.get_subcommands().filter(|one| !one.is_hide_set()).collect();
        assert!(shown.len() > 10, "{shown:?}");
        for command in shown {
            let page = pages.join(format!("wrapyfi-{}.1", command.get_name()));
            let page = std::fs::read_to_string(&page).unwrap();
            for option in command.get_opts().filter_map(clap::Arg::get_long) {
                let option = format!("--{option}").replace('-', r"\-");
                assert!(page.contains(&option), "{} lacks {option}", command.get_name());
            }
        }
        let main = std::fs::read_to_string(pages.join("wrapyfi.1")).unwrap();
        assert!(main.contains(r"wrapyfi\-demo(1)") && main.contains("Exit codes"), "{main}");
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_named() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let failure = write_pages(file.path()).unwrap_err();
        assert!(failure.to_string().contains(&file.path().display().to_string()), "{failure}");
        assert_eq!(failure.code(), 1);
    }
}
