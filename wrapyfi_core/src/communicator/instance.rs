//! One instance of a type with registered methods: their modes and open endpoints.
//!
//! ```text
//!   activate ──▶ Slot { mode, resolved, session } ◀── call: mode, and the session if it is open
//!                  one for each method                 └─ first call: opened on the library's thread
//! ```

use std::fmt;
use std::marker::PhantomData;
use std::ops::Deref;
use std::sync::{Arc, MutexGuard};

use super::context::{CommunicatorContext, Live};
use super::describe::{Class, Method, NamesMethod};
use super::error::{ActivateError, MethodError};
use super::mode::{Mode, Modes, NamesMode};
use super::oneshot;
use super::opening::Opening;
use super::resolve::{Given, Resolved, resolve};
use super::session::{Session, ValueStatus};
use wrapyfi_endpoint::Mutex;

/// Modes and endpoints of one instance's registered methods; a field that `#[communicator]` adds.
pub struct Instance<M> {
    control: Control<M>,
}

impl<M> Deref for Instance<M> {
    type Target = Control<M>;

    fn deref(&self) -> &Control<M> {
        &self.control
    }
}

struct InstanceState {
    class: &'static Class,
    // Declared before `live`, so that endpoints are dropped before their middlewares.
    slots: Vec<Mutex<Slot>>,
    /// Number of the instance among those of its class, from 0.
    number: usize,
    context: CommunicatorContext,
    live: Arc<Live>,
}

#[derive(Default)]
struct Slot {
    mode: Mode,
    /// Fault of the configuration, which every call returns.
    fault: Option<ActivateError>,
    /// Registrations with `$` replaced, from the first call until `close`.
    resolved: Option<Arc<Vec<Resolved>>>,
    session: Option<Arc<Session>>,
}

impl<M: Method> Instance<M> {
    /// A new instance of the class, with the modes that the configuration gives it.
    #[must_use]
    pub fn new(context: &CommunicatorContext) -> Self {
        let class = M::CLASS;
        let shared = Arc::new(InstanceState {
            class,
            slots: class.methods.iter().map(|_| Mutex::default()).collect(),
            number: context.number(class.name),
            context: context.clone(),
            live: context.live(),
        });
        shared.configure();
        Self { control: Control { shared, methods: PhantomData } }
    }

    /// The mode of a method.
    pub fn mode(&self, method: M) -> Mode {
        self.shared.slot(method.index()).map(|slot| slot.mode).unwrap_or_default()
    }

    /// A handle for other threads.
    pub fn control(&self) -> Control<M> {
        self.control.clone()
    }

    /// Begins a call of the method at `index`.
    ///
    /// # Errors
    /// When the configuration gives it a mode that it cannot have.
    pub fn call(&self, index: usize) -> Result<RunningCall, MethodError> {
        let (mode, session) = match self.shared.slot(index).as_deref() {
            Some(Slot { fault: Some(fault), .. }) => return Err(fault.clone().into()),
            Some(slot) => (slot.mode, slot.session.clone()),
            None => (Mode::None, None),
        };
        Ok(RunningCall { shared: Arc::clone(&self.shared), index, mode, session })
    }
}

impl<M> Drop for Instance<M> {
    fn drop(&mut self) {
        self.shared.close_all();
    }
}

impl<M: Method> fmt::Debug for Instance<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let methods = M::ALL.iter().map(|method| (method.name(), self.mode(*method)));
        f.debug_struct(M::CLASS.name)
            .field("instance", &self.shared.number)
            .field("modes", &methods.collect::<Vec<_>>())
            .finish()
    }
}

/// Changes modes, closes, and ends waits from any thread, while calls go on elsewhere.
///
/// ```
/// use std::sync::Arc;
/// use wrapyfi_core::communicator::{CommunicatorContext, Mode, communicator};
/// use wrapyfi_core::middleware::memory::Memory;
///
/// struct Mirror;
/// #[communicator]
/// impl Mirror {
///     #[register(NativeObject, "memory", "/msg", should_wait = false)]
///     fn read(&self) -> String { "hello".to_owned() }
/// }
///
/// # let context = CommunicatorContext::builder().only(Arc::new(Memory::new("memory"))).build();
/// let mut mirror = Mirror.communicator_in(&context);
/// let control = mirror.control();
/// let other = std::thread::spawn(move || control.activate(MirrorMethod::Read, Mode::Disable));
/// other.join().unwrap()?;
/// assert_eq!(mirror.read()?, None);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Control<M> {
    shared: Arc<InstanceState>,
    methods: PhantomData<M>,
}

impl<M> Clone for Control<M> {
    fn clone(&self) -> Self {
        Self { shared: Arc::clone(&self.shared), methods: PhantomData }
    }
}

impl<M> fmt::Debug for Control<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Control").field("class", &self.shared.class.name).finish_non_exhaustive()
    }
}

impl<M: Method> Control<M> {
    /// Chooses the mode of a method, given by value or by name: a mode, its name, or a list by instance. Calls that
    /// wait in the old one end with [`MethodError::Ended`].
    ///
    /// # Errors
    /// When name or mode are unknown, the list is too short, or the method lacks what the mode needs.
    pub fn activate(
        &self,
        method: impl NamesMethod<M>,
        mode: impl NamesMode,
    ) -> Result<(), ActivateError> {
        self.shared.activate(method.find()?, &mode.modes()?)
    }

    /// Ends the waits of a method with [`MethodError::Cancelled`]; its endpoints stay open.
    pub fn cancel(&self, method: M) {
        let session = self.shared.slot(method.index()).and_then(|slot| slot.session.clone());
        if let Some(session) = session {
            session.cancel();
        }
    }

    /// Closes a method's endpoints; calls that wait end with [`MethodError::Ended`].
    pub fn close_method(&self, method: M) {
        self.shared.close(method.index());
    }

    /// Closes every method's endpoints.
    pub fn close(&self) {
        self.shared.close_all();
    }

    /// Status of the endpoints of each value of a method.
    pub fn status(&self, method: M) -> Vec<ValueStatus> {
        self.shared.status(method.index())
    }
}

impl InstanceState {
    fn slot(&self, index: usize) -> Option<MutexGuard<'_, Slot>> {
        self.slots.get(index).map(Mutex::lock)
    }

    /// Takes the modes of the configuration. Calls of a method return the fault of its entry; calls
    /// of all methods return that of an unknown method.
    fn configure(&self) {
        for entry in self.context.configuration().of(self.class.name) {
            let found = self.class.find(&entry.method);
            let result = found.and_then(|index| self.activate(index, &entry.modes));
            let Err(fault) = result else { continue };
            let fault =
                ActivateError::Configured { place: entry.place.clone(), fault: Box::new(fault) };
            tracing::error!("{fault}");
            let concerned =
                self.class.methods.iter().position(|method| method.name == entry.method);
            for (index, _) in self.slots.iter().enumerate() {
                if concerned.is_none_or(|concerned| concerned == index)
                    && let Some(mut slot) = self.slot(index)
                {
                    slot.fault = Some(fault.clone());
                }
            }
        }
    }

    fn activate(&self, index: usize, modes: &Modes) -> Result<(), ActivateError> {
        let mode = match modes {
            Modes::All(mode) => *mode,
            Modes::ByInstance(list) => {
                *list.get(self.number).ok_or_else(|| ActivateError::ListTooShort {
                    method: self.class.label(index),
                    length: list.len(),
                    number: self.number + 1,
                })?
            }
        };
        let spec = self.class.methods.get(index);
        if spec.is_some_and(|spec| spec.is_action) && (mode.sends() || mode.listens()) {
            return Err(ActivateError::NoTopic { method: self.class.label(index), mode });
        }
        if mode.feeds_body() && !spec.is_some_and(|spec| spec.receives) {
            return Err(ActivateError::NothingReceived { method: self.class.label(index), mode });
        }
        let Some(mut slot) = self.slot(index) else { return Ok(()) };
        slot.fault = None;
        if slot.mode == mode {
            return Ok(());
        }
        slot.mode = mode;
        end(slot);
        Ok(())
    }

    fn close(&self, index: usize) {
        let Some(mut slot) = self.slot(index) else { return };
        slot.resolved = None;
        end(slot);
    }

    fn close_all(&self) {
        (0..self.slots.len()).for_each(|index| self.close(index));
    }

    fn status(&self, index: usize) -> Vec<ValueStatus> {
        let session = self.slot(index).and_then(|slot| slot.session.clone());
        match session {
            Some(session) => session.channels.iter().map(super::session::Channel::status).collect(),
            None => {
                let registers = self.class.methods.get(index).map_or(0, |it| it.registers.len());
                vec![ValueStatus::default(); registers]
            }
        }
    }

    fn not_opened(&self, index: usize) -> MethodError {
        let waited_for = "its endpoints to open".to_owned();
        MethodError::Ended { method: self.class.label(index), waited_for }
    }

    /// Opens the endpoints of a method for `mode`; on the library's thread.
    fn open(&self, index: usize, mode: Mode, given: &[Given]) -> Result<Arc<Session>, MethodError> {
        let ended = || self.not_opened(index);
        let resolved = {
            let mut slot = self.slot(index).ok_or_else(ended)?;
            if slot.mode != mode {
                return Err(ended());
            }
            // The first call of another thread has opened the endpoints meanwhile.
            if let Some(session) = &slot.session {
                return Ok(Arc::clone(session));
            }
            match &slot.resolved {
                Some(resolved) => Arc::clone(resolved),
                None => {
                    let default = self.context.default_middleware();
                    let resolved = Arc::new(resolve(self.class, index, default, given)?);
                    slot.resolved = Some(Arc::clone(&resolved));
                    resolved
                }
            }
        };
        let opening = Opening {
            method: self.class.label(index),
            mode,
            context: &self.context,
            live: &self.live,
        };
        let session = opening.open(&resolved).inspect_err(|_error| {
            // The next call may have other arguments, with which the endpoints can be opened.
            if let Some(mut slot) = self.slot(index) {
                slot.resolved = None;
            }
        });
        let session = Arc::new(session?);
        let mut slot = self.slot(index).ok_or_else(ended)?;
        if slot.mode != mode {
            return Err(ended());
        }
        slot.session = Some(Arc::clone(&session));
        Ok(session)
    }
}

/// Ends the waits of a session and drops it, out of every lock.
fn end(mut slot: MutexGuard<'_, Slot>) {
    let session = slot.session.take();
    drop(slot);
    if let Some(session) = session {
        session.end();
    }
}

/// A call that has begun, with its mode and endpoints.
pub struct RunningCall {
    shared: Arc<InstanceState>,
    index: usize,
    mode: Mode,
    session: Option<Arc<Session>>,
}

impl fmt::Debug for RunningCall {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RunningCall").field("mode", &self.mode).finish_non_exhaustive()
    }
}

impl RunningCall {
    /// Mode of the call, which an `activate` meanwhile does not change.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Endpoints of the method; opened now if this is the first call, with the arguments that `$`
    /// names.
    ///
    /// # Errors
    /// When an argument or an option cannot be used, or an endpoint cannot be opened.
    pub async fn open(
        &self,
        in_task: bool,
        given: impl FnOnce() -> Vec<Given>,
    ) -> Result<Arc<Session>, MethodError> {
        if let Some(session) = &self.session {
            return Ok(Arc::clone(session));
        }
        let given = given();
        let (sender, opened) = oneshot::channel();
        let (shared, index, mode) = (Arc::clone(&self.shared), self.index, self.mode);
        self.shared.live.runtime().submit(move || sender.send(shared.open(index, mode, &given)));
        let opened = if in_task { opened.await } else { opened.recv() };
        opened.unwrap_or_else(|| Err(self.shared.not_opened(self.index)))
    }
}
