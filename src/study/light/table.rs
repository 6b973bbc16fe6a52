//! Markdown tables that can also be read on a terminal.

use std::fmt;

/// Rows of equal length; the first columns hold names, the others numbers.
#[derive(Clone, Debug)]
pub(super) struct Table {
    names: usize,
    rows: Vec<Vec<String>>,
}

impl Table {
    pub fn new<S: Into<String>>(names: usize, head: impl IntoIterator<Item = S>) -> Self {
        Self { names, rows: vec![head.into_iter().map(Into::into).collect()] }
    }

    pub fn push(&mut self, row: Vec<String>) {
        debug_assert_eq!(row.len(), self.rows[0].len());
        self.rows.push(row);
    }

    pub fn is_empty(&self) -> bool {
        self.rows.len() == 1
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let columns = self.rows[0].len();
        let width = |c: usize| self.rows.iter().map(|r| r[c].chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..columns).map(|c| width(c).max(3)).collect();
        for (i, row) in self.rows.iter().enumerate() {
            f.write_str("|")?;
            for (c, (cell, &width)) in row.iter().zip(&widths).enumerate() {
                match c < self.names {
                    true => write!(f, " {cell:<width$} |")?,
                    false => write!(f, " {cell:>width$} |")?,
                }
            }
            f.write_str("\n")?;
            if i == 0 {
                f.write_str("|")?;
                for (c, &width) in widths.iter().enumerate() {
                    let end = if c < self.names { '-' } else { ':' };
                    write!(f, " {}{end} |", "-".repeat(width - 1))?;
                }
                f.write_str("\n")?;
            }
        }
        Ok(())
    }
}

/// With this many decimals; a dash where there is none.
pub(super) fn number(value: Option<f64>, decimals: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.decimals$}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_aligned_and_markdown_says_how() {
        let mut table = Table::new(1, ["method", "deg"]);
        assert!(table.is_empty());
        table.push(vec!["ours".into(), number(Some(12.345), 1)]);
        table.push(vec!["ours-fast".into(), number(None, 1)]);
        let expected = "| method    |  deg |\n| --------- | ---: |\n| ours      | 12.3 |\n| ours-fast |    - |\n";
        assert_eq!(table.to_string(), expected);
    }
}
