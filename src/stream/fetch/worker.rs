//! What the threads do: plan, read, decode, put down.

use std::sync::{Arc, Mutex};
use std::time::Instant;

use super::desk::{Desk, locked};
use super::plan::{Job, Plan};
use super::{FetchOptions, Want};
use crate::error::{Error, Result};
use crate::stream::{Access, Fault, FaultKind};

pub(super) type Decode<T> = dyn Fn(u32, Vec<u8>) -> Result<T> + Send + Sync;

pub(super) struct Shared<T> {
    pub access: Arc<dyn Access>,
    pub desk: Desk<T>,
    /// Taken before the desk's own lock, never while that is held.
    plan: Mutex<Plan>,
    decode: Box<Decode<T>>,
}

impl<T> Shared<T> {
    pub(super) fn new(access: Arc<dyn Access>, options: FetchOptions, decode: Box<Decode<T>>) -> Shared<T> {
        let plan = Mutex::new(Plan::new(options, access.size()));
        Shared { access, desk: Desk::new(), plan, decode }
    }

    /// Until the desk is closed.
    pub(super) fn work(&self) {
        while let Some(job) = self.next() {
            let bytes = self.read(&job);
            self.finish(&job, bytes);
        }
    }

    /// Waits for something to do.
    fn next(&self) -> Option<Job> {
        loop {
            let (signal, wake) = {
                let mut plan = locked(&self.plan);
                let plan = &mut *plan;
                let now = Instant::now();
                let stale = plan.is_stale(now);
                let news = self.desk.news(plan.generation, &mut plan.list, stale);
                if news.stop {
                    return None;
                }
                let mut forgotten = 0;
                let is_new = news.list.is_some();
                if let Some((generation, list)) = news.list {
                    forgotten = plan.replace(generation, list);
                }
                if is_new || stale {
                    plan.make(&news.came, now).iter().for_each(|want| self.give_up(want));
                }
                let next = plan.next(news.waiting, now);
                self.desk.begin(next.as_ref(), forgotten, plan.held());
                match next {
                    Ok(job) => return Some(job),
                    Err(idle) => (news.signal, idle.until),
                }
            };
            self.desk.wait(signal, wake);
        }
    }

    /// An index that lies costs neither a request nor memory.
    fn give_up(&self, want: &Want) {
        let why = format!("a patch of {} bytes lies beyond the end, the file has {}", want.bytes, self.access.size());
        let fault = Fault { kind: FaultKind::Short, name: self.access.name().to_owned(), at: want.at, why };
        self.desk.give_up(want.key, Error::Stream(fault));
    }

    fn read(&self, job: &Job) -> Result<Vec<u8>, Fault> {
        // Both a patch and a joined request are counted in 32 bits.
        let mut bytes = vec![0; job.bytes as usize];
        self.access.read_once(job.at, &mut bytes)?;
        Ok(bytes)
    }

    fn finish(&self, job: &Job, bytes: Result<Vec<u8>, Fault>) {
        match bytes {
            Err(fault) => {
                locked(&self.plan).returned(job, false, Instant::now());
                self.desk.failed(fault);
            }
            Ok(bytes) => {
                self.desk.came(job.bytes);
                if let [want] = &job.wants[..] {
                    self.decode(want, bytes);
                } else {
                    for want in &job.wants {
                        let first = (want.at - job.at) as usize;
                        self.decode(want, bytes[first..first + want.bytes as usize].to_vec());
                    }
                }
                locked(&self.plan).returned(job, true, Instant::now());
            }
        }
        // Under the plan's lock, lest an older count come after a newer one.
        let plan = locked(&self.plan);
        self.desk.end(plan.held());
    }

    fn decode(&self, want: &Want, bytes: Vec<u8>) {
        match (self.decode)(want.key, bytes) {
            // Put down before it leaves the plan, so that it is always known to one of the two.
            Ok(patch) => {
                self.desk.put(want.key, u64::from(want.bytes), Ok(patch));
                locked(&self.plan).decoded(want.key);
            }
            Err(error) => {
                self.desk.corrupt();
                if locked(&self.plan).corrupt(want.key, Instant::now()) {
                    self.desk.give_up(want.key, error);
                }
            }
        }
    }
}
