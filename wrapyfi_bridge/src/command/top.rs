//! `wrapyfi top`: the routes of a running bridge, live or as one table.

use std::io::IsTerminal as _;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyEventKind};
use wrapyfi_data::types::Map;
use wrapyfi_interfaces::wrapyfi_msgs::srv::{ListRoutes, ListRoutes_Response};

use super::WAIT_SLICE;
use crate::cli::TopArgs;
use crate::exit::{Failure, Result};
use crate::middlewares::{Endpoints, ros2_hidden};
use crate::on_graph::client::{Asker, LIST_ROUTES, the_bridge};
use crate::output;
use crate::shutdown::Shutdown;
use crate::top::routes::Routes;
use crate::top::screen::Screen;
use crate::why::{OTHER_NODE, same_node, stopped};

/// Longest time that a reply may take: with it, the program still ends in the time that is promised.
const ANSWER: Duration = Duration::from_millis(1500);
/// Longest time that the first reply may take.
const ANSWERED_WITHIN: Duration = Duration::from_secs(3);

/// Shows the routes until `q`, or prints them once.
///
/// # Errors
/// Exit code 2 where there is no terminal to draw on, or several bridges and none was named; 3 where no bridge
/// answers.
pub fn run(args: &TopArgs, shutdown: &Shutdown) -> Result<()> {
    if !args.once && !std::io::stdout().is_terminal() {
        let text = "standard output is no terminal; in a script, run `wrapyfi top --once`";
        return Err(Failure::usage(text));
    }
    let ros2 = ros2_hidden(&Endpoints::default().ros2())?;
    let (node, bridges) = the_bridge(&ros2, args.node.as_deref(), "top", &|| shutdown.requested())?;
    let mut asker = Asker::<ListRoutes>::open(&ros2, &node, LIST_ROUTES)?;
    let mut routes = Routes::new(args.sort, args.filter.clone());
    // The first answer before the terminal is taken: a wrong name is told as any other fault.
    routes.update(asker.ask(Map::new(), ANSWERED_WITHIN).map_err(stopped::or)?.routes);
    if args.once {
        let duplicates = (bridges > 1).then(|| format!("\n{}; {OTHER_NODE}", same_node(&node)));
        return output::line(&(routes.table() + &duplicates.unwrap_or_default()));
    }
    let title = match bridges {
        0 | 1 => node,
        _ => format!("{node}, the node name of {bridges} bridges"),
    };
    std::thread::scope(|scope| {
        let (reply_to, replies) = mpsc::channel();
        // Dropped at the end, which ends the thread.
        let (_running, goes_on) = mpsc::channel::<()>();
        scope.spawn(move || ask_again(&mut asker, args.every, &reply_to, &goes_on));
        let terminal = ratatui::try_init().inspect_err(|_| ratatui::restore());
        let mut terminal = terminal.context("cannot draw on this terminal")?;
        let watched = watch(&mut terminal, Screen::new(title, routes), &replies, shutdown);
        ratatui::restore();
        watched
    })
}

/// A reply, and the instant at which it came.
type Reply = (Instant, Result<ListRoutes_Response>);

/// Asks once each `every` until the answer is not wanted any more.
fn ask_again(
    asker: &mut Asker<ListRoutes>,
    every: Duration,
    reply_to: &Sender<Reply>,
    goes_on: &Receiver<()>,
) {
    while goes_on.recv_timeout(every) == Err(RecvTimeoutError::Timeout) {
        let reply = asker.ask(Map::new(), ANSWER);
        if reply_to.send((Instant::now(), reply)).is_err() {
            return;
        }
    }
}

fn watch(
    terminal: &mut DefaultTerminal,
    mut screen: Screen,
    replies: &Receiver<Reply>,
    shutdown: &Shutdown,
) -> Result<()> {
    let mut heard = Instant::now();
    while !shutdown.requested() {
        while let Ok((at, reply)) = replies.try_recv() {
            match reply {
                Ok(reply) => {
                    heard = at;
                    screen.fault = None;
                    screen.routes.update(reply.routes);
                }
                Err(failure) => screen.fault = Some(failure.to_string()),
            }
        }
        terminal
            .draw(|frame| screen.draw(frame, heard.elapsed()))
            .context("cannot draw on this terminal")?;
        if event::poll(WAIT_SLICE).context("cannot read keys")? {
            let event = event::read().context("cannot read keys")?;
            match event {
                Event::Key(key) if key.kind != KeyEventKind::Release && screen.key(key) => break,
                _ => {}
            }
        }
    }
    Ok(())
}
