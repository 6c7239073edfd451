//! Screen of `wrapyfi top`: what keys do, and what is drawn.

use std::time::Duration;

use ratatui::Frame;
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style, Stylize as _};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Cell, Paragraph, Row as Cells, Sparkline, Table, TableState};

use super::routes::{COLUMNS, Routes, Row, Sort, TEXTS};

/// Width of the column of kinds.
const KIND: u16 = 7;
/// Width of a column of numbers.
const NUMBER: u16 = 8;
/// Rows by which a page moves.
const PAGE: usize = 10;
/// Lines of the part about one route.
const DETAIL: u16 = 11;
/// Time without a reply after which the bridge is said to be silent.
const SILENT_AFTER: Duration = Duration::from_secs(3);

/// State of the screen.
#[derive(Debug)]
pub struct Screen {
    node: String,
    /// Routes of the bridge.
    pub routes: Routes,
    /// Reason that the last question was not answered.
    pub fault: Option<String>,
    selected: usize,
    shows_detail: bool,
    types_filter: bool,
}

impl Screen {
    /// Screen of the bridge whose node has this name.
    pub fn new(node: String, routes: Routes) -> Self {
        Self { node, routes, fault: None, selected: 0, shows_detail: false, types_filter: false }
    }

    /// Does what a key says; true when it ends the program.
    pub fn key(&mut self, key: KeyEvent) -> bool {
        if key.modifiers.contains(KeyModifiers::CONTROL) {
            return key.code == KeyCode::Char('c');
        }
        if self.types_filter {
            match key.code {
                KeyCode::Enter => self.types_filter = false,
                KeyCode::Esc => {
                    self.types_filter = false;
                    self.routes.filter.clear();
                }
                KeyCode::Backspace => {
                    self.routes.filter.pop();
                }
                KeyCode::Char(letter) => self.routes.filter.push(letter),
                _ => {}
            }
            self.selected = 0;
            return false;
        }
        let last = self.routes.visible().len().saturating_sub(1);
        match key.code {
            KeyCode::Char('q') => return true,
            KeyCode::Esc if !self.shows_detail && self.routes.filter.is_empty() => return true,
            KeyCode::Esc if self.shows_detail => self.shows_detail = false,
            KeyCode::Esc => self.routes.filter.clear(),
            KeyCode::Char('s') => self.routes.sort = self.routes.sort.next(),
            KeyCode::Char('/') => self.types_filter = true,
            KeyCode::Enter => self.shows_detail = !self.shows_detail,
            KeyCode::Up | KeyCode::Char('k') => self.selected = self.selected.saturating_sub(1),
            KeyCode::Down | KeyCode::Char('j') => self.selected += 1,
            KeyCode::PageUp => self.selected = self.selected.saturating_sub(PAGE),
            KeyCode::PageDown => self.selected += PAGE,
            KeyCode::Home => self.selected = 0,
            KeyCode::End => self.selected = last,
            _ => {}
        }
        self.selected = self.selected.min(last);
        false
    }

    /// Draws everything. `silence` is the time since the last reply.
    pub fn draw(&self, frame: &mut Frame<'_>, silence: Duration) {
        let shown = self.routes.visible();
        let selected = self.selected.min(shown.len().saturating_sub(1));
        let detail = if self.shows_detail { DETAIL } else { 0 };
        let [head, table, below, keys] = Layout::vertical([
            Constraint::Length(1),
            Constraint::Min(3),
            Constraint::Length(detail),
            Constraint::Length(1),
        ])
        .areas(frame.area());
        frame.render_widget(self.head(silence), head);
        let mut state = TableState::new().with_selected(selected);
        frame.render_stateful_widget(self.table(&shown), table, &mut state);
        if let (true, Some(row)) = (self.shows_detail, shown.get(selected)) {
            draw_detail(frame, row, below);
        }
        frame.render_widget(self.keys(), keys);
    }

    fn head(&self, silence: Duration) -> Line<'_> {
        let mut words =
            vec![self.node.as_str().bold(), Span::raw("  "), Span::raw(self.routes.summary())];
        if silence >= SILENT_AFTER {
            let fault = self.fault.as_deref().unwrap_or("no answer");
            let text = format!("  {fault} (silent for {} s)", silence.as_secs());
            words.push(text.fg(Color::Red));
        }
        Line::from(words)
    }

    fn table(&self, shown: &[&Row]) -> Table<'_> {
        let head = COLUMNS.iter().enumerate().map(|(place, name)| {
            let sorted = place == column(self.routes.sort);
            aligned(place, (*name).to_owned()).style(if sorted {
                Style::new().bold().underlined()
            } else {
                Style::new().bold()
            })
        });
        let rows = shown.iter().map(|row| {
            let cells = row.cells().into_iter().enumerate();
            let cells = cells.map(|(place, text)| aligned(place, text));
            Cells::new(cells).style(Style::new().fg(colour(&row.info.state)))
        });
        let widths = COLUMNS.iter().enumerate().map(|(place, _)| match place {
            0 => Constraint::Min(16),
            1 => Constraint::Length(KIND),
            _ => Constraint::Length(NUMBER),
        });
        Table::new(rows, widths)
            .header(Cells::new(head))
            .row_highlight_style(Style::new().reversed())
    }

    fn keys(&self) -> Line<'_> {
        if self.types_filter {
            return Line::from(vec![
                "filter: ".bold(),
                self.routes.filter.as_str().into(),
                "_".into(),
            ]);
        }
        let filter = match self.routes.filter.as_str() {
            "" => String::new(),
            text => format!("  filter: {text}"),
        };
        let sort = self.routes.sort.word();
        Line::from(format!(
            "q end  s sort ({sort})  / filter  Enter one route  arrows choose{filter}"
        ))
    }
}

/// Place of the column that an order sorts by.
fn column(sort: Sort) -> usize {
    match sort {
        Sort::Name => 0,
        Sort::State => 2,
        Sort::Rate => 3,
        Sort::Bytes => 4,
        Sort::Latency => 6,
        Sort::Queued => 7,
        Sort::Dropped => 8,
    }
}

fn aligned(place: usize, text: String) -> Cell<'static> {
    let line = Line::from(text);
    Cell::from(if place < TEXTS { line } else { line.right_aligned() })
}

fn colour(state: &str) -> Color {
    match state {
        "active" => Color::Green,
        "error" => Color::Red,
        "degraded" => Color::Yellow,
        _ => Color::Gray,
    }
}

/// One route: its ends, its reason, its drops, and its messages a second as a graph, the newest at the right.
fn draw_detail(frame: &mut Frame<'_>, row: &Row, area: Rect) {
    let info = &row.info;
    let block = Block::bordered().title(format!(" {} ", info.key));
    let inner = block.inner(area);
    frame.render_widget(block, area);
    let [text, graph] = Layout::vertical([Constraint::Length(5), Constraint::Min(1)]).areas(inner);
    let or_none = |text: &str| if text.is_empty() { "none".to_owned() } else { text.to_owned() };
    let reason = match info.reason.as_str() {
        "" => String::new(),
        reason if info.cause.is_empty() => format!(": {reason}"),
        reason => format!(" ({}): {reason}", info.cause),
    };
    let goals = match row.goals() {
        none if none.is_empty() => none,
        goals => format!("  goals: {goals}"),
    };
    let lines = vec![
        Line::from(format!(
            "{} -> {}   {} {}",
            info.source, info.destination, info.kind, info.type_name
        )),
        Line::from(format!("{}{reason}", info.state)),
        Line::from(format!(
            "received {}  sent {}  drops: {}{goals}",
            info.received,
            info.sent,
            or_none(&row.drops())
        )),
        Line::from(row.refused()),
        Line::from(format!("msg/s, most {}:", row.history.iter().max().copied().unwrap_or(0))),
    ];
    frame.render_widget(Paragraph::new(lines), text);
    let room = usize::from(graph.width);
    let skip = row.history.len().saturating_sub(room);
    let rates: Vec<u64> = row.history.iter().skip(skip).copied().collect();
    frame
        .render_widget(Sparkline::default().data(rates).style(Style::new().fg(Color::Cyan)), graph);
}

#[cfg(test)]
mod tests {
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;
    use wrapyfi_interfaces::wrapyfi_msgs::msg::RouteInfo;

    use super::*;

    fn screen() -> Screen {
        let route = |key: &str, state: &str, messages_per_s| RouteInfo {
            key: key.to_owned(),
            source: format!("ros2:/{key}"),
            destination: format!("zeromq:/{key}"),
            kind: "topic".to_owned(),
            type_name: "std_msgs/msg/String".to_owned(),
            state: state.to_owned(),
            reason: if state == "active" { String::new() } else { "a broker".to_owned() },
            messages_per_s,
            ..RouteInfo::default()
        };
        let mut routes = Routes::default();
        for rate in 0..38 {
            let rate = f64::from(rate);
            routes.update(vec![route("camera", "active", rate), route("mic", "waiting", 0.0)]);
        }
        Screen::new("/bridge".to_owned(), routes)
    }

    fn drawn(screen: &Screen, silence: Duration) -> String {
        let mut terminal = Terminal::new(TestBackend::new(80, 24)).unwrap();
        terminal.draw(|frame| screen.draw(frame, silence)).unwrap();
        let buffer = terminal.backend().buffer();
        let lines = buffer.content().chunks(80);
        let lines =
            lines.map(|line| line.iter().map(ratatui::buffer::Cell::symbol).collect::<String>());
        lines.map(|line| line.trim_end().to_owned()).collect::<Vec<_>>().join("\n")
    }

    fn press(screen: &mut Screen, keys: &[KeyCode]) -> bool {
        keys.iter().any(|code| screen.key(KeyEvent::new(*code, KeyModifiers::NONE)))
    }

    #[test]
    fn all_routes_are_drawn_with_their_numbers() {
        let text = drawn(&screen(), Duration::ZERO);
        assert!(text.starts_with("/bridge  2 routes, 1 active, 1 waiting"), "{text}");
        let camera = text.lines().find(|line| line.starts_with("camera")).unwrap();
        assert!(camera.contains(" topic   active ") && camera.contains("37.0"), "{text}");
        assert!(!text.contains("silent"), "{text}");
    }

    #[test]
    fn one_route_has_its_ends_its_reason_and_a_graph() {
        let mut screen = screen();
        assert!(!press(&mut screen, &[KeyCode::Down, KeyCode::Enter]));
        let text = drawn(&screen, Duration::ZERO);
        assert!(text.contains("ros2:/mic -> zeromq:/mic   topic std_msgs/msg/String"), "{text}");
        assert!(text.contains("waiting: a broker") && text.contains("drops: none"), "{text}");
        press(&mut screen, &[KeyCode::Up]);
        let text = drawn(&screen, Duration::ZERO);
        assert!(text.contains("msg/s, most 37:") && text.contains('█'), "{text}");
    }

    #[test]
    fn a_filter_is_typed_and_taken_back() {
        let mut screen = screen();
        press(&mut screen, &[KeyCode::Char('/'), KeyCode::Char('m'), KeyCode::Char('q')]);
        assert_eq!(screen.routes.filter, "mq", "q is a letter here");
        press(&mut screen, &[KeyCode::Backspace, KeyCode::Char('i'), KeyCode::Enter]);
        assert!(!drawn(&screen, Duration::ZERO).contains("camera"));
        assert!(!press(&mut screen, &[KeyCode::Esc]));
        assert!(drawn(&screen, Duration::ZERO).contains("camera"));
        assert!(press(&mut screen, &[KeyCode::Esc]));
    }

    #[test]
    fn no_key_selects_beyond_the_last_route() {
        let mut screen = screen();
        press(&mut screen, &[KeyCode::PageDown, KeyCode::Down, KeyCode::Char('s')]);
        assert_eq!((screen.selected, screen.routes.sort), (1, Sort::Rate));
        screen.routes.update(Vec::new());
        press(&mut screen, &[KeyCode::Down, KeyCode::End, KeyCode::Enter]);
        assert_eq!(screen.selected, 0);
        drawn(&screen, Duration::ZERO);
    }

    #[test]
    fn a_bridge_that_does_not_answer_is_told() {
        let mut screen = screen();
        screen.fault = Some("timed out".to_owned());
        let text = drawn(&screen, Duration::from_secs(7));
        assert!(text.contains("timed out (silent for 7 s)"), "{text}");
    }
}
