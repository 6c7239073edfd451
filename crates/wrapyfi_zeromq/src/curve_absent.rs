//! CURVE in a program without it: nothing can be made, so that nothing has to be asked.

#![allow(dead_code, reason = "the same as in `curve`, where it is used")]

use std::convert::Infallible;
use std::sync::Arc;

use super::curve_config::{CurveClient, CurveConfig, CurveError};
use super::zmtp::{HandshakeStep, Kind, Opened};

pub(crate) const OVERHEAD: usize = 0;

/// Keys, of which there are none.
#[derive(Debug)]
pub(crate) enum Keys {}

impl Keys {
    pub(crate) fn load(
        _: &CurveConfig,
        _serves: bool,
        _own_topic: Option<&str>,
    ) -> Result<Arc<Self>, CurveError> {
        Err(CurveError::NotBuilt)
    }

    pub(crate) fn public(&self) -> String {
        match *self {}
    }

    pub(crate) fn is_kept(&self) -> bool {
        match *self {}
    }

    pub(crate) fn is_of_another(&self) -> bool {
        match *self {}
    }

    pub(crate) fn has_list(&self) -> bool {
        match *self {}
    }

    pub(crate) fn entry(&self, _key: &str) -> Option<&CurveClient> {
        match *self {}
    }
}

#[derive(Debug)]
pub(crate) enum Grant {}

impl Grant {
    pub(crate) fn key(&self) -> &str {
        match *self {}
    }

    pub(crate) fn may_publish(&self, _: &[u8]) -> bool {
        match *self {}
    }

    pub(crate) fn may_subscribe(&self, _: &[u8]) -> bool {
        match *self {}
    }
}

#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct Breach(Infallible);

impl Breach {
    pub(crate) fn reason(&self) -> &'static str {
        match self.0 {}
    }

    pub(crate) fn key(&self) -> Option<&str> {
        match self.0 {}
    }

    pub(crate) fn farewell(&self) -> Option<&'static [u8]> {
        match self.0 {}
    }
}

pub(crate) enum Curve {}

impl Curve {
    pub(crate) fn server(keys: &Arc<Keys>, _: Kind) -> Self {
        match **keys {}
    }

    pub(crate) fn client(keys: &Arc<Keys>) -> Result<(Self, Vec<u8>), Breach> {
        match **keys {}
    }

    pub(crate) fn is_server(&self) -> bool {
        match *self {}
    }

    pub(crate) fn grant(&self) -> Option<&Arc<Grant>> {
        match *self {}
    }

    pub(crate) fn handshake(&mut self, _command: &[u8], _: &[u8]) -> Result<HandshakeStep, Breach> {
        match *self {}
    }

    pub(crate) fn seal(
        &mut self,
        _is_command: bool,
        _more: bool,
        _body: &[u8],
        _: &mut Vec<u8>,
    ) -> Result<(), Breach> {
        match *self {}
    }

    pub(crate) fn open(&mut self, _: &mut [u8]) -> Result<Opened, Breach> {
        match *self {}
    }
}
