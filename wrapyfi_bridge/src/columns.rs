//! Rows of text as lines with aligned columns.

/// Lines of the rows: the first `texts` columns are aligned to the left, those of numbers to the right.
#[must_use]
pub fn aligned<const N: usize>(rows: &[[String; N]], texts: usize) -> Vec<String> {
    let mut widths = [0; N];
    for row in rows {
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
