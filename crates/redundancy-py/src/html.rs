//! Tables for notebooks: what `_repr_html_` returns.

/// A table with a title, the names of its columns (none for a list of names and values) and its cells as text.
pub fn table(title: &str, head: &[&str], rows: &[Vec<String>]) -> String {
    let row = |cells: &mut dyn Iterator<Item = String>, tag: &str| {
        let cells: String = cells.map(|cell| format!("<{tag}>{cell}</{tag}>")).collect();
        format!("<tr>{cells}</tr>")
    };
    let head = match head {
        [] => String::new(),
        names => format!("<thead>{}</thead>", row(&mut names.iter().map(|name| escaped(name)), "th")),
    };
    let body: String =
        rows.iter().map(|cells| row(&mut cells.iter().map(|cell| escaped(cell)), "td")).collect();
    format!("<table><caption>{}</caption>{head}<tbody>{body}</tbody></table>", escaped(title))
}

/// A row of a name and a value.
pub fn entry(name: &str, value: impl ToString) -> Vec<String> {
    vec![name.to_owned(), value.to_string()]
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
