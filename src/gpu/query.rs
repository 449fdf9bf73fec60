//! Queries of one frame: timestamps of its passes, and what is visible.

use ash::vk;

use super::context::Context;
use super::resource::Buffer;
use crate::error::{Named, Result};

/// Queries a frame: two a pass, each as many as a multiview pass may write.
const CAPACITY: u32 = 128;

/// A pass that was timed.
#[derive(Debug, Clone)]
struct Timed {
    name: &'static str,
    begin: u32,
    end: u32,
}

/// A query pool and what was written to it in this frame.
#[derive(Debug)]
pub struct Timestamps {
    pool: vk::QueryPool,
    used: u32,
    timed: Vec<Timed>,
}

impl Timestamps {
    /// An empty pool; `None` where the queue has no timestamps.
    pub fn new(context: &Context) -> Result<Option<Timestamps>> {
        if !context.enabled.timestamps {
            return Ok(None);
        }
        let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(CAPACITY);
        // SAFETY: the device lives.
        let pool = unsafe { context.device.create_query_pool(&info, None) }.named("vkCreateQueryPool")?;
        context.name(pool, "timestamps");
        Ok(Some(Timestamps { pool, used: 0, timed: Vec::new() }))
    }

    /// Starts a frame: outside a pass, before any other timestamp of it.
    pub fn reset(&mut self, context: &Context, cmd: vk::CommandBuffer) {
        self.used = 0;
        self.timed.clear();
        // SAFETY: recording outside a pass, and the last frame that used the pool is complete (preconditions).
        unsafe { context.device.cmd_reset_query_pool(cmd, self.pool, 0, CAPACITY) };
    }

    /// Opens a pass; `views` is the number of views of the pass instance that the command is recorded in, 1 outside.
    pub fn begin(&mut self, context: &Context, cmd: vk::CommandBuffer, name: &'static str, views: u32) {
        if self.used + 2 * views > CAPACITY {
            return;
        }
        self.timed.push(Timed { name, begin: self.used, end: self.used + views });
        self.write(context, cmd, views);
    }

    /// Closes the pass opened last.
    pub fn end(&mut self, context: &Context, cmd: vk::CommandBuffer, views: u32) {
        if self.timed.last().is_some_and(|t| t.end == self.used) {
            self.write(context, cmd, views);
        }
    }

    fn write(&mut self, context: &Context, cmd: vk::CommandBuffer, views: u32) {
        // SAFETY: recording, the query is reset and within the pool. A multiview pass writes `views` consecutive ones.
        unsafe {
            context.device.cmd_write_timestamp2(cmd, vk::PipelineStageFlags2::ALL_COMMANDS, self.pool, self.used)
        };
        self.used += views;
    }

    /// Names and durations \[ms\] of the passes, in order, without those that were not timed; call once the frame is
    /// complete.
    pub fn read(&self, context: &Context) -> Result<Vec<(&'static str, f64)>> {
        if self.used == 0 {
            return Ok(Vec::new());
        }
        // Value and availability. A multiview pass owns as many queries as it has views, but only the first is promised a
        // time: lavapipe leaves the others unavailable.
        let mut ticks = vec![[0u64; 2]; self.used as usize];
        let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WITH_AVAILABILITY;
        // SAFETY: the pool lives, the range was reset by a frame that is complete (a precondition).
        match unsafe { context.device.get_query_pool_results(self.pool, 0, &mut ticks, flags) } {
            Ok(()) | Err(vk::Result::NOT_READY) => {}
            Err(e) => return Err(e).named("vkGetQueryPoolResults"),
        }
        let ms = context.limits.timestamp_period as f64 * 1e-6;
        let tick = |query: u32| ticks.get(query as usize).filter(|t| t[1] != 0).map(|t| t[0]);
        let duration = |t: &Timed| Some(tick(t.end)?.wrapping_sub(tick(t.begin)?) as f64 * ms);
        Ok(self.timed.iter().filter_map(|t| Some((t.name, duration(t)?))).collect())
    }

    /// Destroys the pool; the device no longer uses it.
    pub fn destroy(self, context: &Context) {
        // SAFETY: not in use (a precondition), destroyed once.
        unsafe { context.device.destroy_query_pool(self.pool, None) };
    }
}

/// Queries that count the samples of what is drawn.
#[derive(Debug)]
pub struct VisibilityQueries {
    pool: vk::QueryPool,
    /// How many there are.
    pub count: u32,
}

impl VisibilityQueries {
    /// As many, at least 1.
    pub fn new(context: &Context, count: u32) -> Result<VisibilityQueries> {
        let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::OCCLUSION).query_count(count);
        // SAFETY: the device lives.
        let pool = unsafe { context.device.create_query_pool(&info, None) }.named("vkCreateQueryPool")?;
        context.name(pool, "visibility");
        Ok(VisibilityQueries { pool, count })
    }

    /// Readies the first `count`: outside a pass, before any of them is begun.
    pub fn reset(&self, context: &Context, cmd: vk::CommandBuffer, count: u32) {
        // SAFETY: recording outside a pass, and the last frame that used the pool is complete (preconditions).
        unsafe { context.device.cmd_reset_query_pool(cmd, self.pool, 0, count.min(self.count)) };
    }

    /// Draws what `body` draws, and counts its samples.
    pub fn count(&self, context: &Context, cmd: vk::CommandBuffer, query: u32, body: impl FnOnce()) {
        // SAFETY: recording inside a pass; the query was reset, is within the pool, and no other is active.
        unsafe { context.device.cmd_begin_query(cmd, self.pool, query, vk::QueryControlFlags::empty()) };
        body();
        // SAFETY: begun above, in the same pass.
        unsafe { context.device.cmd_end_query(cmd, self.pool, query) };
    }

    /// Copies results as words to the same places of a buffer, once they are there.
    pub fn copy(&self, context: &Context, cmd: vk::CommandBuffer, queries: std::ops::Range<u32>, to: &Buffer) {
        let (first, count) = (queries.start, queries.end - queries.start);
        let (at, flags) = (4 * u64::from(first), vk::QueryResultFlags::WAIT);
        // SAFETY: recording outside a pass; those queries were ended before in this queue, and the buffer has a word for each.
        unsafe { context.device.cmd_copy_query_pool_results(cmd, self.pool, first, count, to.handle, at, 4, flags) };
    }

    /// Whether anything was visible, of the first `count`; call once the frame is complete. `None` for what was not run.
    pub fn read(&self, context: &Context, count: u32) -> Result<Vec<Option<bool>>> {
        if count == 0 {
            return Ok(Vec::new());
        }
        let mut results = vec![[0u32; 2]; count as usize];
        let flags = vk::QueryResultFlags::WITH_AVAILABILITY;
        // SAFETY: the pool lives, the range was reset by a frame that is complete (a precondition).
        match unsafe { context.device.get_query_pool_results(self.pool, 0, &mut results, flags) } {
            Ok(()) | Err(vk::Result::NOT_READY) => {}
            Err(e) => return Err(e).named("vkGetQueryPoolResults"),
        }
        Ok(results.iter().map(|[samples, there]| (*there != 0).then_some(*samples > 0)).collect())
    }

    /// Destroys the pool; the device no longer uses it.
    pub fn destroy(self, context: &Context) {
        // SAFETY: not in use (a precondition), destroyed once.
        unsafe { context.device.destroy_query_pool(self.pool, None) };
    }
}
