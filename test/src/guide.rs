//! Pages of the documentation, whose blocks are run as they are written.

use std::cell::Cell;

use anyhow::{Context as _, bail};

use crate::{Result, repository};

/// Languages of blocks that a test has to run, or to pass over with a reason.
const RUN: [&str; 5] = ["sh", "python", "yaml", "toml", "rust"];

/// The blocks of one page.
#[derive(Debug)]
pub struct Guide {
    page: String,
    blocks: Vec<Block>,
    /// Text that stands in for text of the page.
    replaced: Vec<(String, String)>,
}

#[derive(Debug)]
struct Block {
    language: String,
    line: usize,
    text: String,
    is_used: Cell<bool>,
}

/// A line of a block for the shell.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Line {
    /// The command.
    pub command: String,
    /// The comment behind it, often what it prints.
    pub comment: String,
}

impl Guide {
    /// Reads a page of the repository.
    ///
    /// # Errors
    /// Fails where there is no such page, or a block in it does not end.
    pub fn read(page: &str) -> Result<Self> {
        let text = std::fs::read_to_string(repository().join(page)).context(page.to_owned())?;
        Ok(Self {
            page: page.to_owned(),
            blocks: blocks(&text).context(page.to_owned())?,
            replaced: Vec::new(),
        })
    }

    /// Puts `own` in the place of `written` in all blocks: an address or a port that the test does not have.
    ///
    /// # Errors
    /// Fails where the page does not have it.
    pub fn replace(&mut self, written: &str, own: &str) -> Result {
        if !self.blocks.iter().any(|block| block.text.contains(written)) {
            bail!("{} has no {written} in a block", self.page);
        }
        self.replaced.push((written.to_owned(), own.to_owned()));
        Ok(())
    }

    /// The block in this language that contains `mark`.
    ///
    /// # Errors
    /// Fails where none or several do.
    pub fn block(&self, language: &str, mark: &str) -> Result<String> {
        let found = self
            .blocks
            .iter()
            .filter(|block| block.language == language && block.text.contains(mark))
            .collect::<Vec<_>>();
        let [block] = *found else {
            bail!("{} has {} blocks in {language} with {mark:?}, not one", self.page, found.len())
        };
        block.is_used.set(true);
        let replaced = self.replaced.iter();
        Ok(replaced.fold(block.text.clone(), |text, (written, own)| text.replace(written, own)))
    }

    /// The lines of the block for the shell that contains `mark`.
    ///
    /// # Errors
    /// Fails where none or several do, or where it has another number of lines.
    pub fn lines<const COUNT: usize>(&self, mark: &str) -> Result<[Line; COUNT]> {
        let block = self.block("sh", mark)?;
        let lines = block.lines().filter(|line| !line.is_empty()).map(|line| {
            let (command, comment) = line.split_once(" # ").unwrap_or((line, ""));
            Line { command: command.trim().to_owned(), comment: comment.trim().to_owned() }
        });
        let lines: Vec<_> = lines.collect();
        let count = lines.len();
        lines.try_into().ok().with_context(|| {
            format!("{}: the block with {mark:?} has {count} lines, not {COUNT}", self.page)
        })
    }

    /// Leaves out the blocks that contain `mark`, for a reason.
    ///
    /// # Errors
    /// Fails where none does.
    pub fn pass_over(&self, mark: &str, reason: &str) -> Result {
        let found = self.blocks.iter().filter(|block| block.text.contains(mark));
        let count = found.map(|block| block.is_used.set(true)).count();
        if count == 0 {
            bail!(
                "{} has no block with {mark:?}, which is passed over because {reason}",
                self.page
            );
        }
        Ok(())
    }

    /// Asserts that every block was run or passed over.
    ///
    /// # Errors
    /// With the first one that was not.
    pub fn is_done(&self) -> Result {
        let open = self
            .blocks
            .iter()
            .find(|block| RUN.contains(&&*block.language) && !block.is_used.get());
        match open {
            Some(block) => {
                bail!("{}:{}: nobody runs this block in {}", self.page, block.line, block.language)
            }
            None => Ok(()),
        }
    }
}

fn blocks(text: &str) -> Result<Vec<Block>> {
    let mut blocks = Vec::new();
    let mut lines = text.lines().zip(1_usize..);
    while let Some((line, number)) = lines.next() {
        let Some(language) = line.strip_prefix("```") else { continue };
        let mut text = String::new();
        loop {
            let (line, _) = lines.next().with_context(|| format!("line {number}: no end"))?;
            if line == "```" {
                break;
            }
            text.push_str(line);
            text.push('\n');
        }
        // `rust,no_run` is Rust.
        let language = language.split(',').next().unwrap_or_default().to_owned();
        blocks.push(Block { language, line: number, text, is_used: Cell::new(false) });
    }
    Ok(blocks)
}

/// True when both are the same but for their times, such as `1795471266.624232`.
pub fn same_but_times(one: &str, other: &str) -> bool {
    let without = |text: &str| {
        let words = text.split_inclusive([' ', ',', '\n', '[', ']']).filter(|word| {
            let number = word.trim_end_matches([' ', ',', '\n', '[', ']']);
            !(number.len() >= 12
                && number.starts_with(|c: char| c.is_ascii_digit())
                && number.parse::<f64>().is_ok())
        });
        words.collect::<String>()
    };
    without(one.trim()) == without(other.trim())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_and_lines_are_told_apart() -> Result {
        let text = "a\n```sh\none --arg '[1]'   # {\"on\":true}\n\ntwo\n```\n```rust,no_run\nlet x;\n```\n";
        let mut guide =
            Guide { page: "x.md".to_owned(), blocks: blocks(text)?, replaced: Vec::new() };
        guide.replace("two", "three")?;
        let [one, three] = guide.lines("one")?;
        assert_eq!((&*one.command, &*one.comment), ("one --arg '[1]'", "{\"on\":true}"));
        assert_eq!((&*three.command, &*three.comment), ("three", ""));
        assert!(guide.lines::<3>("one").is_err() && guide.replace("four", "five").is_err());
        let left = guide.is_done().map_err(|error| error.to_string());
        assert_eq!(left, Err("x.md:7: nobody runs this block in rust".to_owned()));
        guide.pass_over("let x", "nothing happens")?;
        guide.is_done()?;
        assert!(blocks("```sh\n").is_err());
        Ok(())
    }

    #[test]
    fn times_are_not_compared() {
        let line = |time: &str| format!("image 640x480 bgr8 921600 bytes at {time}");
        assert!(same_but_times(&line("1795471266.624232"), &line("1795471266.7")));
        assert!(!same_but_times(
            &line("1795471266.624232"),
            "image 640x480 bgr8 921601 bytes at 1795471266.624232"
        ));
        let reply = |time: &str| format!("[\"[is]\",\"enc\",0.0,0,{time},\"[ok]\"]");
        assert!(same_but_times(&reply("1795379650.1483567"), &reply("1795379651.14835")));
        assert!(!same_but_times(
            &reply("1795379650.1483567"),
            "[\"[is]\",\"enc\",1.0,0,1795379650.1483567,\"[ok]\"]"
        ));
    }
}
