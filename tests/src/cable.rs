//! A cable that can be cut: what goes through it stops from one moment to the next, without a word to either end.

use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use tokio::net::UdpSocket;
use tokio::task::JoinHandle;

/// Largest UDP payload.
const LARGEST: usize = 65_536;

/// Carries one client's packets to a server and back until it is cut.
#[derive(Debug)]
pub struct Cable {
    address: SocketAddr,
    carrying: Vec<JoinHandle<()>>,
}

impl Cable {
    /// A cable to a server of this machine.
    pub async fn to(server: SocketAddr) -> Self {
        let socket = async || {
            let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).await.expect("a socket");
            Arc::new(socket)
        };
        let (near, far) = (socket().await, socket().await);
        far.connect(server).await.expect("an address of loopback");
        let address = near.local_addr().expect("a bound socket has an address");
        // Who has called last is who is answered: there is one client.
        let (caller, called) = tokio::sync::watch::channel(None);
        let up = {
            let (near, far) = (near.clone(), far.clone());
            tokio::spawn(async move {
                let mut packet = vec![0; LARGEST];
                loop {
                    // An unreachable port is told here by ICMP; the cable does not care.
                    let Ok((length, from)) = near.recv_from(&mut packet).await else { continue };
                    caller.send_replace(Some(from));
                    let _ = far.send(&packet[..length]).await;
                }
            })
        };
        let down = tokio::spawn(async move {
            let mut packet = vec![0; LARGEST];
            loop {
                let Ok(length) = far.recv(&mut packet).await else { continue };
                let caller: Option<SocketAddr> = *called.borrow();
                if let Some(caller) = caller {
                    let _ = near.send_to(&packet[..length], caller).await;
                }
            }
        });
        Self { address, carrying: vec![up, down] }
    }

    /// The end that a client connects to.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Nothing goes through from now on.
    pub fn cut(&self) {
        for carrying in &self.carrying {
            carrying.abort();
        }
    }
}

impl Drop for Cable {
    fn drop(&mut self) {
        self.cut();
    }
}
