// The page: one link to the robot, and everything that shows what comes over it.
import { Link } from './link.js';
import { Picture } from './picture.js';
import { Top } from './top.js';
import { Strips } from './strips.js';
import { Drive } from './drive.js';

const $ = id => document.getElementById(id);
let state = {}, track = null, me = null, commander = null;

const link = new Link({
  opened: () => top_.furnish(),
  picture: picture => view.show(picture),
  track: newest => { track = newest; view.mark(newest); },
  state: showState,
  you: message => { me = message.you; commander = message.commander; showCommand(); },
  answer: showAnswer,
  gone: () => { state = { mode: 'gone', reasons: ['no word from the robot'] }; showMode(); },
  locked: tried => { $('wrong').textContent = tried ? 'That is not the token.' : ''; sessionStorage.removeItem('token'); $('login').showModal(); },
});
const view = new Picture($('picture'), link, (region, frame) => ask('enrol', { region, frame }));
const top_ = new Top($('top'));
const strips = new Strips($('strips'));
const drive = new Drive($('pad'), $('stick'), link);
window.followerd = { view, link };   // for tests and the curious

// the first button pressed takes the command, if nobody has it
function ask(what, more = {}) {
  if (what !== 'stop' && commander === null) link.send({ do: 'command' });
  link.send({ do: what, ...more });
}

for (const button of document.querySelectorAll('button[data-do]')) {
  button.addEventListener('click', () => {
    if (button.id === 'command' && commander === me && me !== null) link.send({ do: 'release' });
    else ask(button.dataset.do);
  });
}
$('record').addEventListener('click', () => ask('record', { on: !state.recording }));
$('tracker').addEventListener('change', event => ask('choose', { tracker: event.target.value }));
$('login').addEventListener('close', () => { location.hash = $('token').value; $('token').value = ''; link.open(); });
window.addEventListener('keydown', event => {
  if (event.code !== 'Space' || event.repeat || $('login').open) return;
  event.preventDefault();
  ask('stop');
});

function showState(newest) {
  state = newest;
  view.round = state.tracker === 'head';
  showMode();
  top_.show(state, track);
  strips.show(state, track);
  drive.show(state.mode === 'manual' && commander === me);
  showDevices();
  $('record').classList.toggle('on', Boolean(state.recording));
  $('record').textContent = state.recording ? 'Stop recording' : 'Record';
  if (state.recording_stopped) $('answer').textContent = state.recording_stopped;
  showTrackers();
}

function showMode() {
  $('mode').textContent = state.mode;
  $('mode').dataset.mode = state.mode;
  $('reasons').textContent = (state.reasons ?? []).join(' · ');
}

function showCommand() {
  const mine = commander === me;
  $('who').textContent = mine ? 'you command' : commander ? 'somebody else commands' : 'nobody commands';
  $('command').textContent = mine ? 'Give up command' : 'Take command';
  for (const button of document.querySelectorAll('.buttons button, .buttons select')) {
    button.disabled = Boolean(commander) && !mine && button.id !== 'command';
  }
}

function showAnswer(answer) {
  $('answer').textContent = answer.ok ? '' : `${answer.asked || 'request'}: ${answer.error}`;
  $('answer').classList.toggle('refused', !answer.ok);
}

function showDevices() {
  const rows = (state.devices ?? []).map(device => {
    const row = document.createElement('tr');
    const age = device.age === undefined ? troubles(device) : device.age === null ? '–' : `${Math.round(1000 * device.age)} ms`;
    const limit = device.limit ? `${Math.round(1000 * device.limit)} ms` : '';
    const rate = device.rate == null ? '' : `${device.rate.toFixed(1)} Hz`;
    for (const text of [device.name, rate, age, limit]) row.insertCell().textContent = text;
    row.classList.toggle('late', device.fresh === false);
    return row;
  });
  $('devices').tBodies[0].replaceChildren(...rows);
}

function troubles(device) {
  return device.count ?? `${device.errors} ${device.errors === 1 ? 'error' : 'errors'}, lost ${device.lost} times`;
}

function showTrackers() {
  const known = state.trackers ?? [];
  if ($('tracker').options.length !== known.length) {
    $('tracker').replaceChildren(...known.map(name => new Option(name, name)));
  }
  if (document.activeElement !== $('tracker') && state.tracker) $('tracker').value = state.tracker;
}
