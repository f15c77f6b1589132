"""What a fresh machine has and a chroot lacks: systemd, and a person at an editor."""

SYSTEMCTL = r"""#!/bin/bash
# As much of systemd as the unit of wisco2mqtt needs.
unit=/etc/systemd/system/wisco2mqtt.service; pid=/run/wisco2mqtt.pid; log=/run/wisco2mqtt.log
key() { sed -n "s/^$1=//p" "$unit"; }
stop() {
  [ -f $pid ] && kill "$(cat $pid)" && while kill -0 "$(cat $pid)" 2>/dev/null; do sleep 0.1; done
  rm -rf $pid /run/credentials
}
start() {
  [ -f $unit ] || { echo "Failed: Unit wisco2mqtt.service not found." >&2; exit 5; }
  credential=$(key LoadCredential); folder=/run/credentials/wisco2mqtt.service
  install -d -m 500 -o nobody $folder
  install -m 400 -o nobody "${credential#*:}" "$folder/${credential%%:*}" || exit 1
  install -d -m 750 -o nobody /var/lib/wisco2mqtt
  export STATE_DIRECTORY=/var/lib/wisco2mqtt
  setsid setpriv --reuid nobody --regid nogroup --groups dialout \
    $(key ExecStart) >>$log 2>&1 </dev/null & echo $! >$pid
}
case "$*" in
  daemon-reload) ;;
  "enable --now wisco2mqtt"|"start wisco2mqtt") start;;
  "restart wisco2mqtt") stop; start;;
  "disable --now wisco2mqtt"|"stop wisco2mqtt") stop;;
  "reload wisco2mqtt") kill -HUP "$(cat $pid)";;
  *) echo "this machine knows no: systemctl $*" >&2; exit 1;;
esac
"""
JOURNALCTL = "#!/bin/sh\nexec tail -n 100 -f /run/wisco2mqtt.log\n"
# The person pastes what the README shows, with the port of this machine.
NANO = '#!/bin/sh\ncp /root/pasted.yaml "$1"\n'
POLICY = "#!/bin/sh\nexit 101\n"  # packages start no services in a chroot
