use serde::Serialize;

/// Tables of campaigns. `reproduce performance`, `reproduce falsification` and `reproduce tables`
/// print the same document.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Tables {
    /// The pages.
    pub pages: Vec<TablePage>,
}

/// A page of tables.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct TablePage {
    /// Name of the file without ending.
    pub name: String,
    /// Title.
    pub title: String,
    /// The tables of the page.
    pub tables: Vec<Table>,
}

/// A table.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Table {
    /// Caption.
    pub caption: String,
    /// Names of the columns.
    pub columns: Vec<String>,
    /// Rows of cells, as text; names are between backticks.
    pub rows: Vec<Vec<String>>,
}
