//! Where the rows of a table are in their file.

/// The unit that counts the rows of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Counted {
    /// Lines, from 1.
    Lines,
    /// Rows without the header, from 1.
    Rows,
}

/// The number of each row, in little memory where they follow each other.
#[derive(Clone, Debug)]
pub(crate) struct Places {
    counted: Counted,
    rows: usize,
    /// Rows whose number is not the one after that of the row before.
    jumps: Vec<(usize, u64)>,
}

impl Places {
    pub(crate) fn new(counted: Counted) -> Places {
        Places { counted, rows: 0, jumps: Vec::new() }
    }

    /// Returns the numbers from 1 of this many rows.
    pub(crate) fn rows(count: usize) -> Places {
        Places { counted: Counted::Rows, rows: count, jumps: vec![(0, 1)] }
    }

    pub(crate) fn push(&mut self, number: u64) {
        let expected = self.jumps.last().map(|(row, number)| number + (self.rows - row) as u64);
        if expected != Some(number) {
            self.jumps.push((self.rows, number));
        }
        self.rows += 1;
    }

    pub(crate) fn counted(&self) -> Counted {
        self.counted
    }

    pub(crate) fn len(&self) -> usize {
        self.rows
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.rows == 0
    }

    fn number(&self, row: usize) -> u64 {
        let after = self.jumps.partition_point(|(first, _)| *first <= row);
        let Some((first, number)) = after.checked_sub(1).map(|i| self.jumps[i]) else {
            return row as u64 + 1;
        };
        number + (row - first) as u64
    }

    /// Describes a row, such as `line 7`.
    pub(crate) fn text(&self, row: usize) -> String {
        self.counted.text(self.number(row))
    }

    /// Returns the places of these rows, in their order.
    pub(crate) fn of(&self, rows: &[usize]) -> Places {
        let mut found = Places::new(self.counted);
        for row in rows {
            found.push(self.number(*row));
        }
        found
    }
}

impl Counted {
    pub(crate) fn text(self, number: u64) -> String {
        match self {
            Counted::Lines => format!("line {number}"),
            Counted::Rows => format!("row {number}"),
        }
    }
}
