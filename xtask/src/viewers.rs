//! Viewers of a daemon's live view, as many as wanted, every second of whom reads nothing: what a loop must not notice.

use alloc::sync::Arc;
use core::sync::atomic::{AtomicU64, Ordering};
use core::time::Duration;
use std::io::{Read, Write};
use std::net::TcpStream;

/// How long nothing comes until all is said that a server says by itself.
const SAID: Duration = Duration::from_millis(300);

/// Viewers with everything subscribed, until they are dropped.
pub(crate) struct Viewers {
    /// Those who read nothing, and the other ends of those who do.
    streams: Vec<TcpStream>,
    /// Read so far `[bytes]`.
    read: Arc<AtomicU64>,
}

impl Viewers {
    /// Connects `n` of them to the server on this machine.
    pub(crate) fn connect(port: u16, n: usize) -> Result<Self, String> {
        let read = Arc::new(AtomicU64::new(0));
        let mut streams = Vec::new();
        for k in 0..n {
            let stream = subscribed(port).map_err(|e| format!("viewer {k} of port {port}: {e}"))?;
            if k % 2 == 0 {
                let (mut reader, count) = (stream.try_clone().map_err(|e| e.to_string())?, Arc::clone(&read));
                std::thread::spawn(move || {
                    let mut buffer = vec![0; 1 << 16];
                    while let Ok(length @ 1..) = reader.read(&mut buffer) {
                        count.fetch_add(length as u64, Ordering::Relaxed);
                    }
                });
            }
            streams.push(stream);
        }
        Ok(Self { streams, read })
    }

    /// What those who read have read `[bytes]`.
    pub(crate) fn read(&self) -> u64 {
        self.read.load(Ordering::Relaxed)
    }
}

impl Drop for Viewers {
    fn drop(&mut self) {
        // The server may have cut those off who read nothing.
        self.streams.iter().for_each(|stream| drop(stream.shutdown(std::net::Shutdown::Both)));
    }
}

/// A viewer to whom every topic there is will be sent.
fn subscribed(port: u16) -> std::io::Result<TcpStream> {
    let mut stream = TcpStream::connect(("127.0.0.1", port))?;
    let ask = format!(
        "GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
    );
    stream.write_all(ask.as_bytes())?;
    stream.set_read_timeout(Some(SAID))?;
    let (mut told, mut buffer) = (Vec::new(), [0; 4096]);
    while let Ok(length @ 1..) = stream.read(&mut buffer) {
        told.extend_from_slice(&buffer[..length]);
    }
    stream.set_read_timeout(None)?;
    stream.write_all(&frame(&subscription(&String::from_utf8_lossy(&told))))?;
    Ok(stream)
}

/// The message that subscribes to every channel that was advertised.
fn subscription(told: &str) -> String {
    let number = |rest: &str| rest.chars().take_while(char::is_ascii_digit).collect::<String>();
    let channels = told.split("\"id\":").skip(1).map(number).filter(|id| !id.is_empty());
    let all: Vec<String> = (0..).zip(channels).map(|(k, id): (u32, _)| format!("{{\"id\":{k},\"channelId\":{id}}}")).collect();
    format!("{{\"op\":\"subscribe\",\"subscriptions\":[{}]}}", all.join(","))
}

/// A text as a client must send it (RFC 6455, section 5.2), masked with zeros.
fn frame(text: &str) -> Vec<u8> {
    let length = u16::try_from(text.len()).unwrap_or(u16::MAX).to_be_bytes();
    [&[0x81, 0x80 | 126][..], &length, &[0; 4], text.as_bytes()].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_channel_is_subscribed_in_one_masked_frame() {
        let told = "{\"op\":\"advertise\",\"channels\":[{\"id\":3,\"topic\":\"/a\"}]}\u{81}{\"channels\":[{\"id\":12,\"topic\":\"/b\"}]}";
        let text = subscription(told);
        assert_eq!(text, "{\"op\":\"subscribe\",\"subscriptions\":[{\"id\":0,\"channelId\":3},{\"id\":1,\"channelId\":12}]}");
        let bytes = frame(&text);
        assert_eq!((bytes[..4].to_vec(), bytes.len()), (vec![0x81, 0xFE, 0, u8::try_from(text.len()).expect("short")], text.len() + 8));
    }
}
