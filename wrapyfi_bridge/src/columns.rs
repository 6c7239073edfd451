//! Rows of text as lines with aligned columns.

use crate::visible::escaped;

/// Lines of the rows: the first `texts` columns are aligned to the left, those of numbers to the right. Letters that
/// a terminal obeys are shown by their number.
pub fn aligned<const N: usize>(rows: &[[String; N]], texts: usize) -> Vec<String> {
    let rows: Vec<[String; N]> =
        rows.iter().map(|row| row.each_ref().map(|cell| escaped(cell).into_owned())).collect();
    let mut widths = [0; N];
    for row in &rows {
        for (width, cell) in widths.iter_mut().zip(row) {
            *width = (*width).max(cell.chars().count());
        }
    }
    let pad = |(place, (cell, width)): (usize, (&String, usize))| match place < texts {
        true => format!("{cell:<width$}"),
        false => format!("{cell:>width$}"),
    };
    let line = |row: &[String; N]| {
        let cells: Vec<_> = row.iter().zip(widths).enumerate().map(pad).collect();
        cells.join("  ").trim_end().to_owned()
    };
    rows.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_from_outside_move_no_cursor() {
        let rows = [["/a\x1b[31m\n/b".to_owned(), "1".to_owned()]];
        assert_eq!(aligned(&rows, 1), ["/a\\u001b[31m\\u000a/b  1"]);
    }
}
