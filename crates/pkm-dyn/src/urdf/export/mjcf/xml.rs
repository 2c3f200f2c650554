//! Elements with attributes, indented.

use quick_xml::Writer;
use quick_xml::events::{BytesEnd, BytesStart, BytesText, Event};

use super::super::{ExportError, printable};

/// An XML document in the making.
pub(super) struct Xml(Writer<Vec<u8>>);

impl Xml {
    pub(super) fn new() -> Self {
        Self(Writer::new_with_indent(Vec::new(), b' ', 2))
    }

    fn event(&mut self, event: Event<'_>) -> Result<(), ExportError> {
        self.0.write_event(event).map_err(|e| ExportError::Writing(e.to_string()))
    }

    /// Lines of comment. Two hyphens would end it.
    pub(super) fn comment(&mut self, lines: &[String]) -> Result<(), ExportError> {
        let lines: Vec<String> = lines.iter().map(|l| printable(l).replace("--", "- -")).collect();
        let text = format!(" {} ", lines.join("\n     "));
        self.event(Event::Comment(BytesText::from_escaped(text)))
    }

    pub(super) fn open(&mut self, name: &str, attributes: &[(&str, String)]) -> Result<(), ExportError> {
        self.event(Event::Start(element(name, attributes)))
    }

    pub(super) fn close(&mut self, name: &str) -> Result<(), ExportError> {
        self.event(Event::End(BytesEnd::new(name)))
    }

    pub(super) fn empty(&mut self, name: &str, attributes: &[(&str, String)]) -> Result<(), ExportError> {
        self.event(Event::Empty(element(name, attributes)))
    }

    pub(super) fn text(self) -> Result<String, ExportError> {
        let text = String::from_utf8(self.0.into_inner()).map_err(|e| ExportError::Writing(e.to_string()))?;
        Ok(text + "\n")
    }
}

fn element<'n>(name: &'n str, attributes: &[(&str, String)]) -> BytesStart<'n> {
    BytesStart::new(name).with_attributes(attributes.iter().map(|(key, value)| (*key, value.as_str())))
}
