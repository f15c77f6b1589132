"""Examines one address long enough to be sure: which module answers, or that two do.

In Wisco frames any text of the right form looks like a reply (docs/protocol.md section 2). So a
module counts only after two equal answers and a matching read of its outputs.
"""

from collections import Counter
from collections.abc import Iterator
from typing import TypeVar

from bridge.commission.asker import ScannedLine
from bridge.commission.findings import TEXT_PROTOCOLS, Clash, Finding, Found, Noise
from bridge.commission.survey import prober
from bridge.drivers import driver_for
from bridge.drivers.driver import Driver
from bridge.drivers.modbus import ModbusDriver
from bridge.errors import BadReplyError, ExchangeError, NoReplyError, RefusedError
from bridge.model import DIO100, DO100, LineProtocol, ModuleType, OutputSettings
from bridge.protocol.request import Request

T = TypeVar("T")

# With one reply in twenty lost, all six are lost once in sixty million times.
_LOOKS = 6
_AGREE = 2
_SETTINGS_ASKS = 3
_ILLEGAL_FUNCTION = 1  # docs/protocol.md sections 2 and 3: both protocols give it this code
_EVIDENCE = 3


def look(line: ScannedLine, baud: int, protocol: LineProtocol, address: int) -> Iterator[Finding]:
    """Probe one address; if something answers, examine it."""
    examination = Examination(line, baud, protocol, address)
    answers = examination.probe()
    if strays := line.strays():
        yield Noise(None, baud, protocol, strays.hex(" "))
    if answers:
        yield examination.run()


class Examination:
    """One address at one baud rate in one protocol. Used once."""

    def __init__(self, line: ScannedLine, baud: int, protocol: LineProtocol, address: int) -> None:
        self._line = line
        self._baud = baud
        self._protocol = protocol
        self._address = address
        self._asked = 0
        self._answered = 0
        self._damage: list[tuple[int, str]] = []  # number of the exchange, and the damage

    def probe(self) -> bool:
        """Ask once; return whether anything answered. An empty address costs one time-out."""
        line, request = self._line, prober(self._protocol, self._address).read_inputs
        try:
            line.exchange(request, protected=self._protocol is not LineProtocol.WISCO)
        except NoReplyError:
            return False
        except ExchangeError:
            return True
        return True

    def run(self) -> Finding:
        """Return what answers, after `probe` found something."""
        self._line.strays()  # earlier bytes do not belong to this station
        model = self._model()
        fits = model is not None and self._outputs_fit(model)
        takes_modbus, settings = self._modbus(model) if model and fits else (False, None)
        protocols = self._protocols(takes_modbus=takes_modbus)
        if self._is_two_voices() or (model is not None and not fits):
            return self._clash()
        if model is None:
            return self._noise()
        return Found(
            address=self._address,
            model=model,
            baud=self._baud,
            protocols=protocols,
            settings=settings,
            damaged=self._damaged,
            asked=self._asked,
        )

    # --- one question after the other ---------------------------------------------------------

    def _model(self) -> ModuleType | None:
        said: Counter[ModuleType] = Counter()
        for _ in range(_LOOKS):
            answer = self._look(prober(self._protocol, self._address))
            if isinstance(answer, int):
                said[DIO100] += 1
            elif isinstance(answer, RefusedError) and answer.code == _ILLEGAL_FUNCTION:
                said[DO100] += 1
            elif answer is not None:
                self._note(str(answer))
            for model, count in said.items():
                if count == _AGREE:
                    return model
        return None

    def _outputs_fit(self, model: ModuleType) -> bool:
        """Return whether the outputs fit the model: another number of outputs is no valid reply."""
        driver = driver_for(self._protocol, self._address, model)
        for _ in range(_LOOKS):
            answer = self._ask(driver.read_outputs, protected=driver.protected)
            if isinstance(answer, int):
                return True
            if answer is not None:
                self._note(f"its outputs are not those of a {model.name}: {answer}")
        return False

    def _modbus(self, model: ModuleType) -> tuple[bool, OutputSettings | None]:
        """Return whether the module takes Modbus frames, and its settings.

        The checksum also shows if two modules answer.
        """
        if self._address == 0:  # the broadcast address of Modbus
            return False, None
        request = ModbusDriver(self._address, model, self._protocol.in_modbus).read_settings
        for _ in range(_SETTINGS_ASKS):
            answer = self._ask(request, protected=True)
            if isinstance(answer, OutputSettings):
                return True, answer
            if answer is not None:
                return True, None
        return False, None

    def _protocols(self, *, takes_modbus: bool) -> tuple[LineProtocol, ...]:
        if self._protocol is LineProtocol.WISCO and takes_modbus:
            return TEXT_PROTOCOLS
        if self._protocol is LineProtocol.MODBUS_ASCII and self._answers_wisco():
            return TEXT_PROTOCOLS
        return (self._protocol,)

    def _answers_wisco(self) -> bool:
        driver = prober(LineProtocol.WISCO, self._address)
        return any(self._look(driver) is not None for _ in range(_SETTINGS_ASKS))

    def _look(self, driver: Driver) -> int | RefusedError | None:
        return self._ask(driver.read_inputs, protected=driver.protected)

    def _ask(self, request: Request[T], *, protected: bool) -> T | RefusedError | None:
        """Return the result of one exchange; None: no answer, or a damaged one (recorded)."""
        answer: T | RefusedError | None = None
        self._asked += 1
        try:
            answer = self._line.exchange(request, protected=protected)
        except RefusedError as error:
            answer = error
        except BadReplyError as error:
            self._note(str(error))
        except NoReplyError:
            pass
        if strays := self._line.strays():
            self._note(f"more came behind a reply: {strays.hex(' ')}")
        self._answered += answer is not None
        return answer

    # --- what it comes to ---------------------------------------------------------------------

    def _is_two_voices(self) -> bool:
        return self._damaged >= _AGREE and self._damaged >= self._answered

    @property
    def _damaged(self) -> int:
        """Return the number of exchanges with something else than one answer."""
        return len({exchange for exchange, _ in self._damage})

    def _note(self, damage: str) -> None:
        self._damage.append((self._asked, damage))

    def _clash(self) -> Finding:
        heard = self._line.listen()
        if heard:  # it comes whichever module is asked
            return Noise(None, self._baud, self._protocol, heard.hex(" "))
        return Clash(
            address=self._address,
            baud=self._baud,
            protocol=self._protocol,
            evidence=tuple(dict.fromkeys(text for _, text in self._damage))[:_EVIDENCE],
            damaged=self._damaged,
            asked=self._asked,
        )

    def _noise(self) -> Noise:
        evidence = "it answered, and not again: noise or a late reply"
        if self._damage:
            evidence = self._damage[0][1]
        return Noise(self._address, self._baud, self._protocol, evidence)
