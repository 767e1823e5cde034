// Server-sent events through fetch, which unlike EventSource can send a token with its request.

const RETRY_MS = [500, 1000, 2000, 4000];

export function authorization(token) {
  return token ? { Authorization: `Bearer ${token}` } : {};
}

// Calls handlers[event](data) for each event until stop() is called; reconnects when the link breaks.
export function openEventStream(url, token, handlers, onLink) {
  const stopping = new AbortController();
  let tries = 0;

  async function follow() {
    while (!stopping.signal.aborted) {
      try {
        const answer = await fetch(url, { headers: authorization(token), signal: stopping.signal });
        if (!answer.ok) throw new Error((await answer.json()).error);
        onLink("live");
        tries = 0;
        await readEvents(answer.body.getReader(), handlers);
        onLink("lost", "the page's server ended the connection");
      } catch (error) {
        if (stopping.signal.aborted) return;
        onLink("lost", error.message);
      }
      const waitMs = RETRY_MS[Math.min(tries++, RETRY_MS.length - 1)];
      await new Promise((go) => setTimeout(go, waitMs));
    }
  }
  follow();
  return () => stopping.abort();
}

async function readEvents(reader, handlers) {
  const decoder = new TextDecoder();
  let text = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    text += decoder.decode(value, { stream: true });
    const messages = text.split("\n\n");
    text = messages.pop();
    for (const message of messages) dispatch(message, handlers);
  }
}

function dispatch(message, handlers) {
  let event = "", data = "";
  for (const line of message.split("\n")) {
    if (line.startsWith("event: ")) event = line.slice(7);
    else if (line.startsWith("data: ")) data += line.slice(6);
  }
  if (event && handlers[event]) handlers[event](JSON.parse(data));
}
